"""Virtual oscilloscopes: an input of so many bits, a memory, a trigger, a record on request."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.ndimage import map_coordinates

from imotor_ros.nodes.virtual_instruments.laboratory import Laboratory, Signals
from imotor_ros.nodes.virtual_instruments.syntax import OUT_OF_RANGE, Handler, Instrument, Unit

IDLE, ARMED, RECORDING, DONE = "idle", "armed", "recording", "done"


@dataclass
class Input:
    """Vertical settings of an input, and its codes."""

    span: float = 8.0
    codes: np.ndarray | None = None


class VirtualOscilloscope(Instrument):
    """
    What all of them have: inputs, a time base, a single acquisition at the generator's sync.

    Parameters
    ----------
    identity : str
        Answer to ``*IDN?``.
    laboratory : Laboratory
        Where the wires are.
    wires : dict
        Wire of each input, by its number.
    bits : int
        Bits of the converter.
    memory : int
        Samples of an input.
    gain_error, seed : float, int
        Standard deviation of the errors of the vertical scale, and where they come from.

    """

    def __init__(
        self,
        identity: str,
        laboratory: Laboratory,
        *,
        wires: dict[int, str],
        bits: int,
        memory: int,
        gain_error: float,
        seed: int,
    ) -> None:
        self._wires = wires
        self._bits = bits
        self._memory = memory
        self._random = np.random.default_rng(seed)
        self._gains = {n: 1.0 + gain_error * self._random.standard_normal() for n in wires}
        self.reset()
        super().__init__(identity)
        laboratory.listen(self._on_trigger)

    def reset(self) -> None:
        """Forget the acquisition."""
        self._acquisition = object()
        self.inputs = {number: Input() for number in self._wires}
        self.state = IDLE
        self.rate, self.points, self.before = 1e6, 1000, 500
        self.origin = 0.0
        self.source = next(iter(self._wires))
        self.first, self.last = 1, 0

    def set_points(self, points: float) -> None:
        """Set the record length, as far as the memory goes."""
        if points > self._memory:
            self.push_error(OUT_OF_RANGE, f"{points:g} samples")
            return
        self.points = int(points)

    def arm(self) -> None:
        """Wait for the trigger."""
        self._acquisition = object()
        for one in self.inputs.values():
            one.codes = None
        self.state = ARMED

    def _on_trigger(self) -> Callable[[Signals], None] | None:
        if self.state != ARMED or "no_trigger" in self.faults:
            return None
        self.state = RECORDING
        # the converter's clock does not know when the trigger comes
        self.origin = (-self.before + self._random.uniform(0.0, 1.0)) / self.rate
        return partial(self._take, self._acquisition)

    def _take(self, acquisition: object, signals: Signals) -> None:
        """Take the record, unless another acquisition has begun meanwhile."""
        times = self.origin + np.arange(self.points) / self.rate
        places = (times - signals.start) * signals.rate
        taken: dict[int, np.ndarray] = {}
        for number, one in self.inputs.items():
            volts = signals.volts[self._wires[number]]
            seen = map_coordinates(volts, places[None], order=5, mode="nearest")
            half = 2 ** (self._bits - 1)
            codes = np.rint(seen * self._gains[number] / (one.span / (2 * half)))
            taken[number] = np.clip(codes, -half, half - 1).astype(np.int64)
        if self.state == RECORDING and acquisition is self._acquisition:
            for number, record in taken.items():
                self.inputs[number].codes = record
            self.state = DONE

    def words(self) -> np.ndarray:
        """Return the words of the record that is asked for, aligned to the left in 16 bits."""
        codes = self.inputs[self.source].codes
        if codes is None:
            self.push_error((-230, "Data corrupt or stale"))
            return np.zeros(0, np.int64)
        last = self.last or self.points
        chosen: np.ndarray = codes[self.first - 1 : last] << (16 - self._bits)
        return chosen[:-1] if "short_record" in self.faults else chosen

    @property
    def step(self) -> float:
        """Volts of one step of a 16-bit word at the chosen input."""
        return self.inputs[self.source].span / 2**16

    @staticmethod
    def block(data: bytes) -> bytes:
        """Return a definite-length block."""
        return b"#9%09d" % len(data) + data


class TektronixOscilloscope(VirtualOscilloscope):
    """As a Tektronix MSO58 understands it."""

    def __init__(self, laboratory: Laboratory, **options: object) -> None:
        super().__init__("TEKTRONIX,MSO58,VIRTUAL0003,CF:91.1CT FV:1.44", laboratory, **options)  # type: ignore[arg-type]

    def commands(self) -> dict[str, Handler]:
        """Return what it understands."""
        return {
            "*ESR?": lambda _: str(32 if self._errors else 0),
            "ALLEv?": self._on_events,
            "HEADer": lambda _: None,
            "DATa:ENCdg": self._on_encoding,
            "DATa:WIDth": self._on_width,
            "DATa:SOUrce": self._on_source,
            "DATa:STARt": self._on_start,
            "DATa:STOP": self._on_stop,
            "DISplay:GLObal:CH#:STATE": self._on_input,
            "CH#:COUPling": self._on_input,
            "CH#:POSition": self._on_input,
            "CH#:OFFSet": self._on_input,
            "CH#:SCAle": self._on_scale,
            "ACQuire:STATE": self._on_acquire,
            "ACQuire:STATE?": lambda _: "1" if self.state in (ARMED, RECORDING) else "0",
            "ACQuire:STOPAfter": lambda _: None,
            "HORizontal:MODE": lambda _: None,
            "HORizontal:MODE:SAMPLERate": self._on_rate,
            "HORizontal:MODE:SAMPLERate?": lambda _: f"{self.rate:.4E}",
            "HORizontal:MODE:RECOrdlength": lambda unit: self.set_points(unit.number()),
            "HORizontal:MODE:RECOrdlength?": lambda _: str(self.points),
            "HORizontal:DELay:MODe": lambda _: None,
            "HORizontal:POSition": self._on_position,
            "TRIGger:A:TYPe": lambda _: None,
            "TRIGger:A:EDGE:SOUrce": lambda _: None,
            "TRIGger:A:LEVel:AUXiliary": lambda _: None,
            "TRIGger:A:LEVel:AUX": lambda _: None,
            "TRIGger:A:MODe": lambda _: None,
            "TRIGger:STATE?": lambda _: {ARMED: "READY", RECORDING: "TRIGGER"}.get(
                self.state, "SAVE"
            ),
            "WFMOutpre:NR_Pt?": lambda _: str((self.last or self.points) - self.first + 1),
            "WFMOutpre:XINcr?": lambda _: f"{1.0 / self.rate:.9E}",
            "WFMOutpre:XZEro?": lambda _: f"{self.origin:.12E}",
            "WFMOutpre:YMUlt?": lambda _: f"{self.step:.12E}",
            "WFMOutpre:YOFf?": lambda _: "0.0E+0",
            "WFMOutpre:YZEro?": lambda _: "0.0E+0",
            "CURVe?": lambda _: self.block(self.words().astype("<i2").tobytes()),
        }

    def _on_events(self, _unit: Unit) -> str:
        if not self._errors:
            return '0,"No events to report - queue empty"'
        found = ",".join(f'{-code},"{text}"' for code, text in self._errors)
        self._errors.clear()
        return found

    def _on_encoding(self, unit: Unit) -> None:
        if unit.parameters[0].upper() not in ("SRI", "SRIBINARY"):
            raise ValueError("this virtual instrument only takes SRI")

    def _on_width(self, unit: Unit) -> None:
        if unit.number() != 2:
            raise ValueError("this virtual instrument only takes 2")

    def _input(self, unit: Unit) -> Input:
        if unit.suffixes[0] not in self.inputs:
            raise ValueError(f"nothing is connected to CH{unit.suffixes[0]}")
        return self.inputs[unit.suffixes[0]]

    def _on_input(self, unit: Unit) -> None:
        self._input(unit)

    def _on_source(self, unit: Unit) -> None:
        number = int(unit.parameters[0].upper().removeprefix("CH"))
        if number not in self.inputs:
            raise ValueError(f"no record of CH{number}")
        self.source, self.first, self.last = number, 1, self.points

    def _on_start(self, unit: Unit) -> None:
        self.first = int(unit.number())

    def _on_stop(self, unit: Unit) -> None:
        self.last = min(int(unit.number()), self.points)

    def _on_scale(self, unit: Unit) -> None:
        self._input(unit).span = 10.24 * unit.number()

    def _on_acquire(self, unit: Unit) -> None:
        word = unit.parameters[0].upper()
        if word in ("ON", "RUN", "1"):
            self.arm()
        elif self.state != DONE:
            self.state = IDLE

    def _on_rate(self, unit: Unit) -> None:
        self.rate = unit.number()

    def _on_position(self, unit: Unit) -> None:
        self.before = round(0.01 * unit.number() * self.points)


class KeysightOscilloscope(VirtualOscilloscope):
    """As a Keysight InfiniiVision with a digitizer mode understands it."""

    def __init__(self, laboratory: Laboratory, **options: object) -> None:
        self._was_armed = False
        self._position = 0.0
        identity = "KEYSIGHT TECHNOLOGIES,DSO-X 4034A,VIRTUAL0004,07.40"
        super().__init__(identity, laboratory, **options)  # type: ignore[arg-type]

    def commands(self) -> dict[str, Handler]:
        """Return what it understands."""
        return {
            "WAVeform:FORMat": lambda _: None,
            "WAVeform:BYTeorder": lambda _: None,
            "WAVeform:UNSigned": lambda _: None,
            "WAVeform:POINts:MODE": lambda _: None,
            "WAVeform:POINts": lambda _: None,
            "WAVeform:SOURce": self._on_source,
            "WAVeform:PREamble?": self._on_preamble,
            "WAVeform:DATA?": lambda _: self.block((self.words() + 2**15).astype("<u2").tobytes()),
            "CHANnel#:DISPlay": lambda _: None,
            "CHANnel#:COUPling": lambda _: None,
            "CHANnel#:OFFSet": lambda _: None,
            "CHANnel#:RANGe": self._on_range,
            "STOP": self._on_stop,
            "SINGle": lambda _: self._on_single(),
            "ACQuire:TYPE": lambda _: None,
            "ACQuire:DIGitizer": lambda _: None,
            "ACQuire:SRATe": self._on_rate,
            "ACQuire:SRATe?": lambda _: f"{self.rate:+.6E}",
            "ACQuire:POINts": lambda unit: self.set_points(unit.number()),
            "ACQuire:POINts?": lambda _: str(self.points),
            "TIMebase:MODE": lambda _: None,
            "TIMebase:POSition": self._on_position,
            "TRIGger:MODE": lambda _: None,
            "TRIGger:EDGE:SOURce": lambda _: None,
            "TRIGger:EDGE:LEVel": lambda _: None,
            "TRIGger:SWEep": lambda _: None,
            "AER?": lambda _: self._on_arm_event(),
            "OPERegister:CONDition?": lambda _: str(8 if self.state in (ARMED, RECORDING) else 0),
        }

    def _on_source(self, unit: Unit) -> None:
        number = int(unit.parameters[0].upper().removeprefix("CHANNEL").removeprefix("CHAN"))
        if number not in self.inputs:
            raise ValueError(f"no record of channel {number}")
        self.source = number

    def _on_preamble(self, _unit: Unit) -> str:
        return (
            f"+1,+0,{self.points:+d},+1,{1.0 / self.rate:+.8E},{self.origin:+.12E},+0,"
            f"{self.step:+.8E},+0.0E+00,+32768"
        )

    def _on_range(self, unit: Unit) -> None:
        if unit.suffixes[0] in self.inputs:
            self.inputs[unit.suffixes[0]].span = unit.number()
            return
        raise ValueError("no such input")

    def _on_stop(self, _unit: Unit) -> None:
        if self.state != DONE:
            self.state = IDLE

    def _on_single(self) -> None:
        self.before = round((self.points / self.rate / 2.0 - self._position) * self.rate)
        self.arm()
        self._was_armed = True

    def _on_rate(self, unit: Unit) -> None:
        self.rate = unit.number()

    def _on_position(self, unit: Unit) -> None:
        self._position = unit.number()

    def _on_arm_event(self) -> str:
        was_armed, self._was_armed = self._was_armed, False
        return "+1" if was_armed else "+0"
