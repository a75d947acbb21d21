"""The bench as its YAML file describes it: instruments, ranges, and which quantity is where."""

from __future__ import annotations

from dataclasses import dataclass

from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
)
from imotor_ros.core.parameters import Parameters, group, parameter
from imotor_ros.errors import BadInputError


@dataclass(frozen=True)
class GeneratorSettings(Parameters):
    """The waveform generator, and the amplifier behind it."""

    address: str = parameter(
        "TCPIP0::127.0.0.1::5025::SOCKET", "VISA resource name of the waveform generator"
    )
    dialect: str = parameter("keysight_33500", "name of its dialect, or path of a dialect file")
    serial: str = parameter("", "serial number that it must have; empty: any")
    output: str = parameter("1", "number of the output that feeds the amplifier")
    setup: str = parameter("", "further commands after the reset, one a line")
    memory: int = parameter(1_000_000, "samples that a record may have", low=2)
    lowest_rate: float = parameter(1.0, "lowest sample rate", unit="Hz", low=0.0, excludes_low=True)
    highest_rate: float = parameter(
        250e6, "highest sample rate", unit="Hz", low=0.0, excludes_low=True
    )
    highest_voltage: float = parameter(
        10.0, "largest voltage that it puts out into the amplifier's input", unit="V", low=0.0,
        excludes_low=True,
    )  # fmt: skip
    least_peak_to_peak: float = parameter(
        2e-3, "smallest amplitude that it takes, peak to peak", unit="V", low=0.0,
        excludes_low=True,
    )  # fmt: skip
    amplifier_gain: float = parameter(
        20.0, "drive voltage over the voltage of the generator", unit="V/V", low=0.0,
        excludes_low=True,
    )  # fmt: skip
    lowest_drive_voltage: float = parameter(
        -20.0, "lowest voltage that may be put on the motor", unit="V", high=0.0
    )
    highest_drive_voltage: float = parameter(
        120.0, "highest voltage that may be put on the motor", unit="V", low=0.0
    )
    ramp_time: float = parameter(
        0.02, "time in which the amplitude goes to zero when it is stopped", unit="s", low=0.0,
        high=0.05,
    )  # fmt: skip
    ramp_steps: int = parameter(20, "steps of that ramp", low=1, high=1000)


@dataclass(frozen=True)
class OscilloscopeSettings(Parameters):
    """One oscilloscope."""

    address: str = parameter("", "VISA resource name; empty: there is none")
    dialect: str = parameter("tektronix_mso5", "name of its dialect, or path of a dialect file")
    serial: str = parameter("", "serial number that it must have; empty: any")
    setup: str = parameter("", "further commands after the reset, one a line")
    memory: int = parameter(10_000_000, "samples of an input that it holds", low=100)
    sample_rates: tuple[float, ...] = parameter(
        (1e5, 2.5e5, 5e5, 1e6, 2.5e6, 5e6, 1e7), "its sample rates", unit="Hz", low=0.0,
        excludes_low=True,
    )  # fmt: skip
    bits: int = parameter(12, "bits of its converter", unit="bit", low=6, high=16)
    segment_length: int = parameter(250_000, "samples read at a time", low=1)
    trigger_source: str = parameter("AUX", "input that the generator's sync output feeds")
    trigger_level: float = parameter(1.0, "trigger level", unit="V")
    gain_uncertainty: float = parameter(
        0.01, "standard uncertainty of its vertical scale (relative)", low=0.0, high=0.2
    )
    offset_uncertainty: float = parameter(
        0.0, "standard uncertainty of its zero, over the input range", low=0.0, high=0.2
    )

    def check(self) -> None:
        """Check that there is a rate."""
        if not self.sample_rates:
            raise BadInputError("is empty", where="sample_rates", bound="a list of rates (Hz)")


@dataclass(frozen=True)
class ChannelSettings(Parameters):
    """One quantity: where it is measured, and what makes a voltage of it."""

    oscilloscope: int = parameter(1, "which oscilloscope", low=1, high=2)
    input: str = parameter("", "number of its input")
    input_range: float = parameter(
        10.0, "largest voltage of either sign that the input shows", unit="V", low=0.0,
        excludes_low=True,
    )  # fmt: skip
    factor: float = parameter(1.0, "SI units of the quantity per volt; negative: it is inverted")
    range: float = parameter(
        0.0, "largest magnitude that the transducer gives (SI unit); 0: that of the input",
        low=0.0,
    )  # fmt: skip
    gain_uncertainty: float = parameter(
        0.01, "standard uncertainty of the transducer's factor (relative)", low=0.0, high=0.2
    )
    offset_uncertainty: float = parameter(
        0.0, "standard uncertainty of the transducer's zero (SI unit)", low=0.0
    )
    noise_density: float = parameter(
        0.0, "noise density of the transducer (SI unit per square root of Hz)", low=0.0
    )
    bandwidth: float = parameter(
        0.0, "upper -3 dB frequency of the transducer; 0: unknown", unit="Hz", low=0.0
    )
    low_pass: str = parameter(
        "", "low-pass that makes the bandwidth", options=("", "bessel_3", "first_order")
    )
    high_pass_frequency: float = parameter(
        0.0, "lower -3 dB frequency; 0: DC-coupled", unit="Hz", low=0.0
    )
    delay: float = parameter(
        0.0, "time by which the transducer's output lags the quantity", unit="s", low=0.0, high=1.0
    )
    instrument: str = parameter("", "make and model of the transducer")
    serial: str = parameter("", "serial number of the transducer")

    def check(self) -> None:
        """Check that there is an input."""
        if self.factor == 0.0:
            raise BadInputError("is zero", where="ChannelSettings.factor", value=0.0)

    @property
    def span(self) -> float:
        """Largest magnitude of the quantity that is shown (SI unit)."""
        shown = self.input_range * abs(self.factor)
        return min(shown, self.range) if self.range > 0.0 else shown


@dataclass(frozen=True)
class BenchSettings(Parameters):
    """Everything about the bench that does not depend on the run."""

    generator: GeneratorSettings = group(GeneratorSettings)
    oscilloscope_1: OscilloscopeSettings = group(OscilloscopeSettings)
    oscilloscope_2: OscilloscopeSettings = group(OscilloscopeSettings)
    rod_velocity: ChannelSettings = group(ChannelSettings)
    slider_velocity: ChannelSettings = group(ChannelSettings)
    load_force: ChannelSettings = group(ChannelSettings)
    voltage_monitor: ChannelSettings = group(ChannelSettings)
    current: ChannelSettings = group(ChannelSettings)
    trigger_delay: float = parameter(
        0.0, "time from the oscilloscopes' trigger to sample 0 at the amplifier's input",
        unit="s", low=-1e-3, high=1e-3,
    )  # fmt: skip
    highest_frequency: float = parameter(
        50e3, "highest frequency that has to be right between the oscilloscope's samples",
        unit="Hz", low=0.0, excludes_low=True,
    )  # fmt: skip
    resampling_tolerance: float = parameter(
        1e-4, "largest relative error of a sine of that frequency", low=0.0, high=0.1,
        excludes_low=True,
    )  # fmt: skip
    connect_timeout: float = parameter(
        3.0, "longest wait for a connection", unit="s", low=0.1, high=60.0
    )
    reply_timeout: float = parameter(
        5.0, "longest wait for an answer", unit="s", low=0.1, high=600.0
    )
    arm_timeout: float = parameter(
        5.0, "longest wait until an oscilloscope waits for its trigger", unit="s", low=0.1,
        high=600.0,
    )  # fmt: skip
    trigger_timeout: float = parameter(
        5.0, "longest wait for the record after the end of the run", unit="s", low=0.1, high=600.0
    )
    is_simulated: bool = parameter(False, "whether the instruments are virtual ones")

    def check(self) -> None:
        """Check that every channel has an input of its own on an oscilloscope that is there."""
        taken: dict[tuple[int, str], str] = {}
        for name, channel in self.channels.items():
            scope = self.oscilloscopes.get(channel.oscilloscope)
            if not self.oscilloscopes:
                return  # nothing is set up yet
            if scope is None:
                raise BadInputError(
                    "has no address", where=f"{name}: oscilloscope", value=channel.oscilloscope
                )
            place = (channel.oscilloscope, channel.input)
            if not channel.input or place in taken:
                raise BadInputError(
                    "is no input of its own", where=f"{name}: input", value=channel.input,
                    bound="one that no other channel has",
                )  # fmt: skip
            taken[place] = name

    @property
    def oscilloscopes(self) -> dict[int, OscilloscopeSettings]:
        """The oscilloscopes that are there, by number."""
        both = {1: self.oscilloscope_1, 2: self.oscilloscope_2}
        return {number: one for number, one in both.items() if one.address}

    @property
    def channels(self) -> dict[str, ChannelSettings]:
        """The channels by name."""
        return {
            ROD_VELOCITY: self.rod_velocity,
            SLIDER_VELOCITY: self.slider_velocity,
            LOAD_FORCE: self.load_force,
            VOLTAGE: self.voltage_monitor,
            CURRENT: self.current,
        }


_QUANTITIES = {
    ROD_VELOCITY: ("velocity", "m/s"),
    SLIDER_VELOCITY: ("velocity", "m/s"),
    LOAD_FORCE: ("force", "N"),
    VOLTAGE: ("voltage", "V"),
    CURRENT: ("current", "A"),
}


def unit_of(name: str) -> str:
    """Return the SI unit of a channel."""
    return _QUANTITIES[name][1]


def step_of(name: str, settings: BenchSettings) -> float:
    """Return the step of a channel (SI unit): that of the oscilloscope's converter."""
    channel = settings.channels[name]
    bits = settings.oscilloscopes[channel.oscilloscope].bits
    return float(2.0 * channel.input_range * abs(channel.factor) / 2**bits)


def describe(
    name: str, settings: BenchSettings, rate: float, identities: dict[int, str]
) -> ChannelDescription:
    """
    Return the description of a channel: transducer, oscilloscope input and its converter.

    Parameters
    ----------
    name : str
        The channel.
    settings : BenchSettings
        The bench.
    rate : float
        Samples per second of the oscilloscope (Hz).
    identities : dict
        What the oscilloscopes are, by number.

    Notes
    -----
    The steps of the converter count as white noise of variance step^2/12 up to half the sample
    rate, twice, since what is read between its samples is rounded to steps again; and as an
    uncertainty of the zero of step/sqrt(12), for a signal that stays within one.
    """
    channel = settings.channels[name]
    scope = settings.oscilloscopes[channel.oscilloscope]
    scale = abs(channel.factor)
    step = step_of(name, settings)
    zero = scope.offset_uncertainty * channel.input_range * scale
    quantity, unit = _QUANTITIES[name]
    noise = 2.0 * step**2 / 12.0 / (rate / 2.0)
    identity = identities.get(channel.oscilloscope, "")
    return ChannelDescription(
        name=name,
        quantity=quantity,
        unit=unit,
        range=channel.span,
        resolution=step,
        gain_uncertainty=float((channel.gain_uncertainty**2 + scope.gain_uncertainty**2) ** 0.5),
        offset_uncertainty=float((channel.offset_uncertainty**2 + zero**2 + step**2 / 12.0) ** 0.5),
        noise_density=float((channel.noise_density**2 + noise) ** 0.5),
        bandwidth=channel.bandwidth,
        high_pass_frequency=channel.high_pass_frequency,
        delay=channel.delay,
        instrument=f"{channel.instrument or 'transducer'} on {identity or 'oscilloscope'}",
        serial=channel.serial,
        is_simulated=settings.is_simulated,
        low_pass=channel.low_pass,
    )
