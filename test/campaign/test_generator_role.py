"""The generator's last gate: nothing beyond the motor's limits ever leaves it."""

from __future__ import annotations

import numpy as np
import pytest

from imotor_ros.campaign.roles.generator import GeneratorRole
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.drive_limits import DriveLimits, program_demand
from imotor_ros.errors import DriveLimitError

LIMITS = DriveLimits()


def drive(seed: int, share: float = 1.0) -> DriveProgram:
    """Return a run whose voltage spans the range from end to end, times share."""
    draws = np.random.default_rng(seed)
    count = int(draws.integers(1, 5))
    sizes, phases = draws.uniform(0.1, 1.0, count), draws.uniform(-np.pi, np.pi, count)
    frequency, ramp = float(draws.uniform(500.0, 3000.0)), float(draws.uniform(0.2, 2.0))

    def make(scale: float, offset: float) -> DriveProgram:
        return steady_drive(
            run_id="run", epoch=0, sample_rate=1e6, offset=offset, hold_time=2e-3, bias_time=5e-4,
            fundamental_frequency=frequency, amplitudes=(scale * sizes).tolist(),
            phases=phases.tolist(), ramp_periods=ramp,
        )  # fmt: skip

    # the 0 V of the bias are no extreme: a sum of sines is on both sides of its offset
    wave = program_demand(make(1.0, 0.0))
    scale = share * (120.0 + 20.0) / (wave.highest - wave.lowest)
    return make(scale, 120.0 - scale * wave.highest)


def send_all(role: GeneratorRole) -> np.ndarray:
    """Send and acknowledge until nothing is left."""
    parts = []
    while (block := role.next_block()) is not None:
        parts.append(block.samples)
        role.acknowledge(role.sent)
    return np.concatenate(parts or [np.empty(0)])


@pytest.mark.parametrize("seed", range(30))
def test_program_that_just_fits_is_sent_and_stays_in_the_range(seed: int) -> None:
    program = drive(seed)
    voltage = send_all(GeneratorRole(program, 1000, 1, LIMITS))
    assert voltage.min() >= -20.0
    assert voltage.max() <= 120.0
    assert np.ptp(voltage) > 130.0, "it goes to the ends of the range"
    assert voltage == pytest.approx(program.render(0, program.length), abs=1e-6)


@pytest.mark.parametrize("seed", range(30))
def test_stop_at_any_moment_stays_in_the_range_and_ends_at_zero(seed: int) -> None:
    """Not one sample of a stop is out of it; ramps reach 0 V however early it comes."""
    program = drive(seed)
    block = int(np.random.default_rng(seed).integers(1, program.length // 2))
    role = GeneratorRole(program, block, 1, LIMITS)
    first = role.next_block()
    assert first is not None
    role.stop()
    role.acknowledge(role.sent)
    voltage = np.concatenate([first.samples, send_all(role)])
    assert voltage.min() >= -20.0
    assert voltage.max() <= 120.0
    # the last sample is one step of the last ramp before 0 V
    assert abs(voltage[-1]) < 1.0
    assert abs(role.program.render(role.program.length, 1)[0]) == 0.0
    jumps = np.abs(np.diff(voltage)).max() * 1e6
    assert jumps <= program_demand(role.program).slope * (1 + 1e-9)


def test_program_beyond_the_range_is_refused_before_its_first_sample() -> None:
    program = drive(3, share=1.01)
    with pytest.raises(DriveLimitError, match=r"needs a voltage of .* V, expected at (most|least)"):
        GeneratorRole(program, 1000, 1, LIMITS)


def test_limits_of_another_motor_are_its_own() -> None:
    wide = LIMITS.replace(lowest_voltage=-100.0, highest_voltage=200.0)
    program = drive(3, share=1.01)
    assert len(send_all(GeneratorRole(program, 1000, 1, wide))) == program.length


def test_sample_that_should_not_be_there_is_not_sent() -> None:
    """Should a rendered sample be out of range in spite of all: the block stays where it is."""

    class Broken(DriveProgram):
        def render(self, first: int, count: int) -> np.ndarray:
            voltage = super().render(first, count)
            voltage[count // 2] = 1e3
            return voltage

    good = drive(1)
    role = GeneratorRole(good, 1000, 1, LIMITS)
    role.program = Broken(
        good.run_id, good.epoch, good.sample_rate, good.fundamental_frequency, good.segments
    )
    with pytest.raises(DriveLimitError, match="1000 V"):
        role.next_block()
    assert role.sent == 0
