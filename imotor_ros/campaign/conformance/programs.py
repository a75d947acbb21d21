"""The voltages by which a driver is checked: small enough for any stack of the range."""

from __future__ import annotations

from dataclasses import dataclass

from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.errors import BadInputError

FREQUENCIES = (1000.0, 2000.0, 4000.0, 8000.0)
"""Sines (Hz) of the check; the slider slides in the fast ones, if it ever does."""

REPEATED = FREQUENCIES[2]
"""The sine (Hz) that comes again at the end."""

SAWTOOTH = "sawtooth"
REPEAT = "repeat"
REST = "rest"
LEVEL = "level"


@dataclass(frozen=True)
class CheckParameters(Parameters):
    """What the check may do to the driver."""

    sample_rate: float = parameter(
        1e6, "samples per second of the check's programs", unit="Hz", low=1e5, high=1e8
    )
    lowest_voltage: float = parameter(-20.0, "lowest voltage allowed", unit="V", high=0.0)
    highest_voltage: float = parameter(
        120.0, "highest voltage allowed", unit="V", low=0.0, excludes_low=True
    )
    offset: float = parameter(36.0, "voltage about which the sines swing", unit="V")
    amplitude: float = parameter(
        18.0, "amplitude of the sines", unit="V", low=0.0, excludes_low=True
    )
    voltage_timeout: float = parameter(
        1.0, "silence of the generator after which the driver takes the voltage off",
        unit="s", low=0.05, high=60.0,
    )  # fmt: skip
    alignment_tolerance: float = parameter(
        3e-6, "lag behind the voltage that may be left after the declared delays",
        unit="s", low=0.0, high=1e-3,
    )  # fmt: skip
    epoch: int = parameter(
        946_684_800_123_456_789, "time of sample 0 of all runs (ns since 1970)", low=0
    )

    def check(self) -> None:
        """Check that the sines keep to the range."""
        for value in (self.offset - self.amplitude, self.offset + self.amplitude):
            if not self.lowest_voltage <= value <= self.highest_voltage:
                raise BadInputError(
                    "reaches beyond the range", where="offset and amplitude", value=value,
                    bound=f"{self.lowest_voltage:g} to {self.highest_voltage:g} V",
                )  # fmt: skip


def sine_label(frequency: float) -> str:
    """Return the label of the segment with the steady sine of a frequency (Hz)."""
    return f"sine {frequency:g}"


class ProgramBuilder:
    """
    Puts segments one after the other, each from where the last one ended.

    Parameters
    ----------
    parameters : CheckParameters
        Rate, offset and amplitude.

    """

    def __init__(self, parameters: CheckParameters) -> None:
        self._parameters = parameters
        self._segments: list[DriveSegment] = []
        self._offset = 0.0

    def level(self, offset: float, time: float, label: str) -> None:
        """Go linearly to an offset (V) within a time (s)."""
        length = self._samples(time)
        self._segments.append(DriveSegment(label, length, 0.0, 0.0, self._offset, offset))
        self._offset = offset

    def burst(
        self, frequency: float, time: float, label: str,
        amplitudes: tuple[float, ...], phases: tuple[float, ...] = (0.0,),
    ) -> None:  # fmt: skip
        """Swing with amplitudes (V) and phases (rad) for a time (s), ramps before and after."""
        zero = (0.0,) * len(amplitudes)
        ramp = self._samples(2.0 / frequency)
        u = self._offset
        for name, length, start, end in (
            (f"{label}: up", ramp, zero, amplitudes),
            (label, self._samples(time), amplitudes, amplitudes),
            (f"{label}: down", ramp, amplitudes, zero),
        ):
            self._segments.append(
                DriveSegment(name, length, frequency, frequency, u, u, start, end, phases)
            )

    def build(self, run_id: str, frequency: float = REPEATED) -> DriveProgram:
        """Return the program."""
        return DriveProgram(
            run_id=run_id,
            epoch=self._parameters.epoch,
            sample_rate=self._parameters.sample_rate,
            fundamental_frequency=frequency,
            segments=tuple(self._segments),
        )

    def _samples(self, time: float) -> int:
        return max(1, round(time * self._parameters.sample_rate))


def characterising_program(parameters: CheckParameters, run_id: str) -> DriveProgram:
    """
    Return the program of the main run: a level, sines, a sawtooth, a sine again, and rest.

    Sines of one amplitude have one and the same lag by hysteresis: what grows with the frequency
    is delay. In the sawtooth the slider goes forward.
    """
    builder = ProgramBuilder(parameters)
    builder.level(parameters.offset, 4e-3, "bias")
    builder.level(parameters.offset, 3e-3, LEVEL)
    for frequency in FREQUENCIES:
        builder.burst(frequency, 10e-3, sine_label(frequency), (parameters.amplitude,))
    motion = parabolic_sawtooth(2, 1.0, fundamental_frequency=REPEATED)
    scale = parameters.amplitude / sum(motion.amplitudes)
    wave = tuple(scale * float(one) for one in motion.amplitudes)
    phases = tuple(float(one) for one in motion.phases)
    builder.burst(REPEATED, 14e-3, SAWTOOTH, wave, phases)
    builder.burst(REPEATED, 10e-3, REPEAT, (parameters.amplitude,))
    builder.level(0.0, 4e-3, "release")
    builder.level(0.0, 3e-3, REST)
    return builder.build(run_id)


def short_program(
    parameters: CheckParameters, run_id: str, hold_time: float = 10e-3
) -> DriveProgram:
    """Return a short program: up to the offset, a sine, and back to zero."""
    builder = ProgramBuilder(parameters)
    builder.level(parameters.offset, 4e-3, "bias")
    builder.burst(REPEATED, hold_time, "hold", (parameters.amplitude,))
    builder.level(0.0, 4e-3, "release")
    return builder.build(run_id)
