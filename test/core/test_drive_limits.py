"""What a drive program needs, and what may not leave the generator."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from imotor_ros.core.drive import DriveProgram, DriveSegment, steady_drive
from imotor_ros.core.drive_limits import (
    DriveDemand,
    DriveLimits,
    program_demand,
    segment_demand,
)
from imotor_ros.core.motor import MotorParameters
from imotor_ros.errors import BadInputError, DriveLimitError

RATE = 1e6
LIMITS = DriveLimits()


def drive(
    amplitudes: tuple[float, ...] = (36.9, 14.1, 5.8, 2.0), offset: float = 50.0
) -> DriveProgram:
    return steady_drive(
        run_id="test", epoch=0, sample_rate=RATE, fundamental_frequency=4625.0, offset=offset,
        amplitudes=amplitudes, phases=(0.3, -1.0, 2.0, -2.5)[: len(amplitudes)], hold_time=5e-3,
        bias_time=1e-3,
    )  # fmt: skip


def random_program(seed: int) -> DriveProgram:
    """Return segments of any kind: steps, sweeps, ramps of every number at once."""
    draws = np.random.default_rng(seed)
    count = int(draws.integers(1, 6))
    frequencies = draws.uniform(100.0, 20e3, 5)
    offsets = draws.uniform(-10.0, 60.0, 5)
    sizes = draws.uniform(0.0, 20.0, (5, count)) * draws.integers(0, 2, (5, count))
    segments = tuple(
        DriveSegment(
            f"part {i}", int(draws.integers(50, 3000)), frequencies[i], frequencies[i + 1],
            offsets[i], offsets[i + 1], tuple(sizes[i]), tuple(sizes[i + 1]),
            tuple(draws.uniform(-math.pi, math.pi, count)),
        )
        for i in range(4)
    )  # fmt: skip
    return DriveProgram("random", 0, RATE, 1000.0, segments)


def rendered(program: DriveProgram) -> NDArray[np.float64]:
    return program.render(0, program.length)


def test_demand_of_a_steady_drive_is_exact() -> None:
    """Extremes and slope of the waveform, found on a grid of 0.1 % of its shortest wave."""
    program = drive()
    time = np.linspace(0.0, 1.0 / 4625.0, 60_000)
    hold = program.segments[2]
    angle = 2.0 * np.pi * 4625.0 * np.outer(np.arange(1, 5), time)
    wave = np.array(hold.end_amplitudes) @ np.sin(angle + np.array(hold.phases)[:, None])
    demand = segment_demand(hold, RATE)
    assert demand.highest == pytest.approx(50.0 + wave.max(), abs=1e-6)
    assert demand.lowest == pytest.approx(50.0 + wave.min(), abs=1e-6)
    slope = np.abs(np.gradient(wave, time)).max()
    assert demand.slope == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("seed", range(40))
def test_no_sample_of_any_program_is_beyond_its_demand(seed: int) -> None:
    program = random_program(seed)
    demand = program_demand(program)
    voltage = rendered(program)
    assert voltage.max() <= demand.highest + 1e-12
    assert voltage.min() >= demand.lowest - 1e-12
    within = np.concatenate(
        [np.diff(voltage[slice(*program.span(segment.label))]) for segment in program.segments]
    )
    assert np.abs(within).max() * RATE <= demand.slope * (1.0 + 1e-9)


@pytest.mark.parametrize("seed", range(40))
def test_no_sample_of_any_stop_is_beyond_the_demand_of_the_program(seed: int) -> None:
    """Wherever a program is cut; it ends at 0 V, which every motor allows."""
    program = random_program(seed)
    demand = program_demand(program)
    draws = np.random.default_rng(1000 + seed)
    for index in draws.integers(0, program.length, 10):
        stopped = program.stopped_at(int(index), ramp_length=100, release_length=200)
        voltage = rendered(stopped)
        assert voltage.max() <= max(demand.highest, 0.0) + 1e-12
        assert voltage.min() >= min(demand.lowest, 0.0) - 1e-12
        assert stopped is program or abs(stopped.render(stopped.length, 1)[0]) == 0.0
        LIMITS.replace(
            lowest_voltage=min(demand.lowest, 0.0),
            highest_voltage=max(demand.highest, 1.0),
            slew_rate=1e12,
            current_limit=1e12,
        ).check_program(stopped)


@pytest.mark.parametrize(
    ("change", "quantity", "unit", "allowed"),
    [
        ({"highest_voltage": 80.0}, "voltage", "V", 80.0),
        ({"lowest_voltage": 0.0, "highest_voltage": 1e3}, "voltage", "V", 0.0),
        ({"slew_rate": 1e6}, "slew rate", "V/s", 1e6),
        ({"current_limit": 1.0}, "current", "A", 1.0),
    ],
)
def test_limit_names_what_is_needed_and_what_is_allowed(
    change: dict[str, float], quantity: str, unit: str, allowed: float
) -> None:
    amplitudes = (75.0, 20.0) if "lowest_voltage" in change else (36.9, 14.1, 5.8, 2.0)
    program = drive(amplitudes)
    with pytest.raises(DriveLimitError) as caught:
        LIMITS.replace(**change).check_program(program)
    error = caught.value
    assert (error.quantity, error.unit, error.allowed) == (quantity, unit, allowed)
    demand = segment_demand(program.segments[2], RATE)
    needed = {
        "V": demand.lowest if "lowest_voltage" in change else demand.highest,
        "V/s": demand.slope,
        "A": demand.slope * LIMITS.load_capacitance,
    }[unit]
    # the ramp comes first, and needs as much or a little more
    assert error.needed == pytest.approx(needed, rel=0.2)
    assert f"{error.needed:.4g} {unit}" in str(error)
    assert f"{allowed:.4g} {unit}" in str(error)
    assert isinstance(error, BadInputError)


def test_program_of_the_paper_is_within_its_limits() -> None:
    LIMITS.check_program(drive())


@pytest.mark.parametrize("offset", [-20.5, 120.5])
def test_bias_out_of_range_is_refused(offset: float) -> None:
    with pytest.raises(DriveLimitError, match="bias"):
        LIMITS.check_program(drive((0.0,), offset))


def test_contained_samples_are_in_the_range_and_unchanged() -> None:
    voltage = rendered(drive())
    assert np.array_equal(LIMITS.contain(voltage, "test"), voltage)
    edge = np.array([120.0 + 1e-8, -20.0 - 1e-8])
    assert np.array_equal(LIMITS.contain(edge, "test"), [120.0, -20.0])


@pytest.mark.parametrize("value", [120.001, -20.001, np.nan, np.inf, -np.inf])
def test_sample_out_of_range_is_not_let_out(value: float) -> None:
    voltage = np.full(100, 50.0)
    voltage[37] = value
    with pytest.raises(DriveLimitError, match="block"):
        LIMITS.contain(voltage, "block")


def test_room_is_the_smaller_of_both_sides() -> None:
    assert LIMITS.room(50.0) == 70.0
    assert LIMITS.room(90.0) == 30.0
    assert LIMITS.room(130.0) == 0.0
    assert LIMITS.largest_slope == pytest.approx(10.0 / 1.6124e-6)


def test_demand_without_harmonics_is_that_of_the_offset() -> None:
    segment = DriveSegment("bias", 1000, 0.0, 0.0, 0.0, 50.0, (), (), ())
    assert segment_demand(segment, RATE) == DriveDemand(0.0, 50.0, pytest.approx(50e3))


def test_default_limits_are_those_of_the_default_motor() -> None:
    motor = MotorParameters().drive_limits
    assert motor.load_capacitance == pytest.approx(LIMITS.load_capacitance, rel=1e-4)
    assert motor.replace(load_capacitance=LIMITS.load_capacitance) == LIMITS
