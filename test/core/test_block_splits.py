"""Every streaming stage gives the same samples, to the last bit, however its stream is cut."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.amplifier import Amplifier, AmplifierParameters
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.filters import StreamFilter
from imotor_ros.core.force_sensor import ForceSensor, ForceSensorParameters
from imotor_ros.core.hysteresis import Hysteresis, PlayHysteresis
from imotor_ros.core.linear_systems import bessel_low_pass, first_order_high_pass
from imotor_ros.core.monitor import CurrentMonitorParameters, Monitor, VoltageMonitorParameters
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.slider import LoadParameters
from imotor_ros.core.stator import Stator, StatorParameters
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

RATE = 1e6
LENGTH = 24_000
Array = NDArray[np.float64]
Stage = Callable[[Array], Sequence[Array | SampleFlag]]


def _low_pass() -> Stage:
    sampled = StreamFilter(bessel_low_pass(100e3), RATE, delay=4.3e-6)
    return lambda x: (sampled.process(x),)


def _high_pass() -> Stage:
    sampled = StreamFilter(first_order_high_pass(20.0), RATE, interpolation="linear")
    return lambda x: (sampled.process(x),)


def _vibrometer() -> Stage:
    parameters = VibrometerParameters(
        drop_out_rate=2000.0, high_pass_frequency=20.0, velocity_range=0.1
    )
    return Vibrometer(parameters, RATE, 1, "rod/velocity").process


def _force_sensor() -> Stage:
    return ForceSensor(ForceSensorParameters(force_range=1.0, drift_rate=1.0), RATE, 1).process


def _voltage_monitor() -> Stage:
    return Monitor(VoltageMonitorParameters(range=1.0), RATE, 1).process


def _current_monitor() -> Stage:
    return Monitor(CurrentMonitorParameters(range=1.0), RATE, 1).process


def _amplifier() -> Stage:
    parameters = AmplifierParameters(lowest_voltage=-1.0, highest_voltage=1.0, slew_rate=1e5)
    return Amplifier(parameters, RATE, load_capacitance=1e-6).process


def _stator() -> Stage:
    # the plays of the paper's motor need more than the volt or two of the signal
    stator = Stator(StatorParameters(), RATE)
    return lambda x: stator.process(50.0 * x)


def _linear_stator() -> Stage:
    return Stator(StatorParameters.linear(), RATE).process


def _hysteresis() -> Stage:
    plays = Hysteresis(PlayHysteresis(0.5, (0.1, 0.5, 0.9), (0.3, 0.2, 0.1)))
    return lambda x: (plays.process(x),)


def _motor() -> Stage:
    load = LoadParameters(lower_stop=-10e-6, upper_stop=10e-6, spring_stiffness=100.0)
    motor = VirtualMotor(MotorParameters(load=load), RATE, 1)

    def process(x: Array) -> Sequence[Array | SampleFlag]:
        return tuple(vars(motor.process(60.0 * x)).values())

    return process


STAGES = [
    _low_pass,
    _high_pass,
    _vibrometer,
    _force_sensor,
    _voltage_monitor,
    _current_monitor,
    _amplifier,
    _hysteresis,
    _stator,
    _linear_stator,
    _motor,
]


def _signal() -> Array:
    """A sum of harmonics with an offset, faster than any limit here and beyond any range."""
    time = np.arange(LENGTH) / RATE
    angle = 2.0 * np.pi * 9250.0 * time
    return 0.5 + np.sin(angle) + 0.4 * np.sin(2.0 * angle + 1.0) + 0.3 * np.sin(0.05 * angle)


def _run(make: Callable[[], Stage], signal: Array, lengths: Sequence[int]) -> list[object]:
    """Return all outputs joined: arrays one after the other, flags or-ed."""
    stage, start = make(), 0
    outputs: list[Sequence[Array | SampleFlag]] = []
    for length in lengths:
        outputs.append(stage(signal[start : start + length]))
        start += length
    assert start == len(signal)
    return [_joined(parts) for parts in zip(*outputs, strict=True)]


def _joined(parts: Sequence[Array | SampleFlag]) -> object:
    if isinstance(parts[0], SampleFlag):
        return SampleFlag(np.bitwise_or.reduce([int(part) for part in parts]))
    return np.concatenate(parts)


def _cut(length: int, block: int) -> list[int]:
    whole, rest = divmod(length, block)
    return [block] * whole + [rest] * (rest > 0)


@pytest.mark.parametrize("make", STAGES)
@pytest.mark.parametrize("block", [10_000, 777])
def test_stage_does_not_depend_on_block_length(make: Callable[[], Stage], block: int) -> None:
    signal = _signal()
    whole = _run(make, signal, [LENGTH])
    parts = _run(make, signal, _cut(LENGTH, block))
    for one, other in zip(whole, parts, strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("make", STAGES)
def test_stage_takes_single_samples_and_empty_blocks(make: Callable[[], Stage]) -> None:
    signal = _signal()[:2000]
    whole = _run(make, signal, [2000])
    parts = _run(make, signal, [0, *[1] * 1000, 0, *[1] * 1000])
    for one, other in zip(whole, parts, strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("make", STAGES)
def test_stage_leaves_its_input_alone_and_takes_read_only_samples(
    make: Callable[[], Stage],
) -> None:
    signal = _signal()
    copy = signal.copy()
    signal.setflags(write=False)
    make()(signal)
    assert np.array_equal(signal, copy)


@pytest.mark.parametrize(
    ("make", "flags"),
    [
        (_vibrometer, SampleFlag.DROP_OUT | SampleFlag.OVER_RANGE),
        (_force_sensor, SampleFlag.OVER_RANGE),
        (_amplifier, SampleFlag.VOLTAGE_CLIPPED | SampleFlag.SLEW_LIMITED),
    ],
)
def test_signal_reaches_the_limits(make: Callable[[], Stage], flags: SampleFlag) -> None:
    """Else the tests above would not see whether a limit depends on the blocks."""
    assert make()(_signal())[-1] == flags
