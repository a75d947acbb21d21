"""Virtual waveform generators: a record has a sample rate with one, a period with the other."""

from __future__ import annotations

import numpy as np

from imotor_ros.nodes.virtual_instruments.laboratory import Laboratory, Samples
from imotor_ros.nodes.virtual_instruments.syntax import (
    BLOCK_ERROR,
    OUT_OF_RANGE,
    TOO_MUCH_DATA,
    Handler,
    Instrument,
    Unit,
)


class WaveformGenerator(Instrument):
    """
    What both have: an output, an amplitude, one burst at a trigger.

    Parameters
    ----------
    identity : str
        Answer to ``*IDN?``.
    laboratory : Laboratory
        What the output is connected to.
    memory : int
        Samples that a record may have.

    """

    highest_peak_to_peak = 20.0
    lowest_peak_to_peak = 1e-3

    def __init__(self, identity: str, laboratory: Laboratory, memory: int) -> None:
        self._laboratory = laboratory
        self._memory = memory
        self.record: Samples = np.zeros(0)
        self.reset()
        super().__init__(identity)

    def reset(self) -> None:
        """Output off, no burst."""
        self.is_on = False
        self.peak_to_peak = 0.1
        self.rate = 40e3
        self.is_burst = False
        self.is_bus = False
        self._laboratory.change(0.0)

    def commands(self) -> dict[str, Handler]:
        """Return what both understand."""
        return {
            "SOURce#:VOLTage": self._on_amplitude,
            "SOURce#:VOLTage:OFFSet": self._expect(0.0),
            "SOURce#:BURSt:MODE": self._expect_word("TRIG", "TRIGGERED"),
            "SOURce#:BURSt:NCYCles": self._expect(1.0),
            "SOURce#:BURSt:STATe": self._on_burst,
            "OUTPut#": self._on_output,
            "OUTPut#:STATe": self._on_output,
            "*TRG": self._on_trigger,
        }

    @staticmethod
    def _expect(value: float) -> Handler:
        def check(unit: Unit) -> None:
            if unit.number() != value:
                raise ValueError(f"this virtual instrument only takes {value:g}")

        return check

    @staticmethod
    def _expect_word(*words: str) -> Handler:
        def check(unit: Unit) -> None:
            if not unit.parameters or unit.parameters[0].upper() not in words:
                raise ValueError(f"this virtual instrument only takes {words[0]}")

        return check

    def _on_amplitude(self, unit: Unit) -> None:
        value = unit.number()
        if not self.lowest_peak_to_peak <= value <= self.highest_peak_to_peak:
            self.push_error(OUT_OF_RANGE, f"amplitude {value:g}")
            return
        self.peak_to_peak = value
        if self.is_on:
            self._laboratory.change(0.5 * value)

    def _on_burst(self, unit: Unit) -> None:
        self.is_burst = unit.switch()

    def _on_output(self, unit: Unit) -> None:
        self.is_on = unit.switch()
        if not self.is_on:
            self._laboratory.change(0.0)

    def _on_trigger(self, _unit: Unit) -> None:
        if not (self.is_burst and self.is_bus and len(self.record)):
            self.push_error((-211, "Trigger ignored"))
            return
        amplitude = 0.5 * self.peak_to_peak if self.is_on else 0.0
        self._laboratory.play(self.record, self.rate, amplitude)

    def take(self, record: Samples) -> None:
        """Take a record between -1 and 1 into the memory."""
        if len(record) > self._memory:
            self.push_error(TOO_MUCH_DATA, f"{len(record)} samples")
            return
        if np.max(np.abs(record), initial=0.0) > 1.0:
            self.push_error(OUT_OF_RANGE, "a word")
            return
        self.record = record
        if "error_after_upload" in self.faults:
            self.push_error((-780, "Not able to load specified arb"))


class KeysightGenerator(WaveformGenerator):
    """As a Keysight 33500B understands it."""

    def __init__(self, laboratory: Laboratory, memory: int) -> None:
        self._arbs: dict[str, Samples] = {}
        self._is_swapped = False
        super().__init__("Keysight Technologies,33522B,VIRTUAL0001,5.03", laboratory, memory)

    def reset(self) -> None:
        """Forget all records as well."""
        super().reset()
        self._arbs = {}
        self._is_swapped = False

    def commands(self) -> dict[str, Handler]:
        """Return what it understands."""
        return {
            **super().commands(),
            "FORMat:BORDer": self._on_order,
            "SOURce#:DATA:VOLatile:CLEar": self._on_clear,
            "SOURce#:DATA:VOLatile:FREE?": lambda _: str(self._memory),
            "SOURce#:DATA:ARBitrary:DAC": self._on_upload,
            "SOURce#:FUNCtion": self._expect_word("ARB"),
            "SOURce#:FUNCtion:ARBitrary": self._on_select,
            "SOURce#:FUNCtion:ARBitrary:SRATe": self._on_rate,
            "SOURce#:VOLTage:RANGe:AUTO": lambda _: None,
            "OUTPut#:LOAD": self._expect_word("INF", "INFINITY"),
            "OUTPut:SYNC": lambda _: None,
            "TRIGger#:SOURce": self._on_source,
        }

    def _on_order(self, unit: Unit) -> None:
        self._is_swapped = unit.parameters[0].upper().startswith("SWAP")

    def _on_clear(self, _unit: Unit) -> None:
        self._arbs = {}

    def _on_upload(self, unit: Unit) -> None:
        if unit.block is None or len(unit.block) % 2 or not unit.parameters:
            self.push_error(BLOCK_ERROR)
            return
        if len(unit.block) < 16:
            self.push_error((-777, "Too few points"))
            return
        words = np.frombuffer(unit.block, "<i2" if self._is_swapped else ">i2")
        self.take(words / 32767.0)
        self._arbs[unit.parameters[0].upper()] = self.record

    def _on_select(self, unit: Unit) -> None:
        name = unit.parameters[0].upper()
        if name not in self._arbs:
            self.push_error((-786, "Specified arb waveform does not exist"), name)
            return
        self.record = self._arbs[name]

    def _on_rate(self, unit: Unit) -> None:
        if not 1e-6 <= unit.number() <= 250e6:
            self.push_error(OUT_OF_RANGE, "sample rate")
            return
        self.rate = unit.number()

    def _on_source(self, unit: Unit) -> None:
        self.is_bus = unit.parameters[0].upper() == "BUS"


class TektronixGenerator(WaveformGenerator):
    """As a Tektronix AFG3000 understands it: an edit memory of 14-bit words, played in a period."""

    def __init__(self, laboratory: Laboratory, memory: int) -> None:
        self._frequency = 1e6
        super().__init__("TEKTRONIX,AFG3022C,VIRTUAL0002,SCPI:99.0 FV:3.2.2", laboratory, memory)

    def commands(self) -> dict[str, Handler]:
        """Return what it understands."""
        return {
            **super().commands(),
            "TRACe:DATA": self._on_upload,
            "SOURce#:FUNCtion:SHAPe": self._expect_word("EMEM", "EMEMORY"),
            "SOURce#:FREQuency": self._on_frequency,
            "SOURce#:VOLTage:UNIT": self._expect_word("VPP"),
            "OUTPut#:IMPedance": self._expect_word("INF", "INFINITY"),
            "TRIGger:SOURce": self._on_source,
        }

    def _on_upload(self, unit: Unit) -> None:
        if unit.block is None or len(unit.block) % 2 or unit.parameters != ("EMEM",):
            self.push_error(BLOCK_ERROR)
            return
        self.take(np.frombuffer(unit.block, ">u2").astype(np.float64) / 8191.0 - 1.0)
        self.rate = self._frequency * len(self.record)

    def _on_frequency(self, unit: Unit) -> None:
        self._frequency = unit.number()
        self.rate = round(self._frequency * len(self.record), 6)

    def _on_source(self, unit: Unit) -> None:
        self.is_bus = unit.parameters[0].upper() == "EXT"
