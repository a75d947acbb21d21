"""A stop of the generator: zero within 50 ms of what is consumed, whatever rate, block, ramp."""

from __future__ import annotations

import numpy as np
import pytest

from imotor_ros.campaign.roles.generator import (
    BLOCK_TIME,
    STOP_TIME,
    UNDER_WAY_TIME,
    GeneratorRole,
)
from imotor_ros.campaign.roles.plant import PlantRole
from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.drive import DriveProgram, DriveSegment, Ending, steady_drive
from imotor_ros.core.motor import MotorParameters
from imotor_ros.errors import BadInputError


def a_program(rate: float, bias_time: float = 5e-3, ramp_periods: float = 1.0) -> DriveProgram:
    """Return a run of 0.4 s and more."""
    return steady_drive(
        run_id="run", epoch=0, sample_rate=rate, fundamental_frequency=rate / 200, offset=50.0,
        amplitudes=(30.0, 5.0), phases=(0.0, 1.0), hold_time=0.4, bias_time=bias_time,
        ramp_periods=ramp_periods,
    )  # fmt: skip


def send_up_to(role: GeneratorRole, index: int, rng: np.random.Generator) -> list[SampleBlock]:
    """Send all that may be sent until `index` is passed, acknowledging as a driver might."""
    blocks: list[SampleBlock] = []
    while True:
        while (block := role.next_block()) is not None:
            blocks.append(block)
        if role.sent >= index or role.is_finished:
            return blocks
        role.acknowledge(int(rng.integers(role.consumed + 1, role.sent + 1)))


@pytest.mark.parametrize("seed", range(25))
def test_stop_comes_to_zero_within_its_time(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rate = float(rng.choice([1e4, 51.2e3, 2e5, 1e6]))
    program = a_program(rate, float(rng.uniform(1e-3, 0.1)), float(rng.uniform(0.5, 400.0)))
    block, window = int(rng.choice([1, 777, 10_000, 10**7])), int(rng.choice([1, 8, 1000]))
    role = GeneratorRole(program, max(block, int(rate * 1e-3)), window)
    blocks = send_up_to(role, int(rng.uniform(0.0, 1.0) * program.length), rng)
    cut, consumed = role.sent, role.consumed
    assert cut - consumed <= UNDER_WAY_TIME * rate
    assert all(len(one.samples) <= BLOCK_TIME * rate for one in blocks)
    stopped = role.stop()
    assert stopped.ending is Ending.STOPPED
    assert (stopped.length - consumed) / rate <= STOP_TIME
    assert stopped.length >= cut
    while not role.is_finished:
        blocks += send_up_to(role, stopped.length, rng)
        role.acknowledge(role.sent)
    voltage = np.concatenate([one.samples for one in blocks])
    assert len(voltage) == stopped.length
    assert voltage[:cut].tobytes() == program.render(0, cut).tobytes(), "what was sent stays"
    assert voltage[-1] == pytest.approx(0.0, abs=60.0 / (1e-3 * rate)), "one step of the release"
    assert stopped.render(stopped.length, 1)[0] == 0.0
    assert role.stop() is stopped, "a second stop changes nothing"


def test_abandoned_program_sends_nothing_more() -> None:
    role = GeneratorRole(a_program(1e6), 10_000, 8)
    assert role.next_block() is not None
    assert role.abandon().ending is Ending.ABANDONED
    assert role.next_block() is None


@pytest.mark.parametrize(("offset", "amplitudes"), [(10.0, (0.0,)), (0.0, (-5.0,))])
def test_program_that_leaves_a_voltage_is_refused(
    offset: float, amplitudes: tuple[float, ...]
) -> None:
    zero = (0.0,)
    last = DriveSegment("last", 100, 1e3, 1e3, 0.0, offset, zero, amplitudes, zero)
    with pytest.raises(BadInputError, match="run: end of last: does not lead to 0 V, got"):
        GeneratorRole(DriveProgram("run", 0, 1e6, 1e3, (last,)), 10, 1)


def test_plant_goes_to_zero_by_itself_without_a_jump() -> None:
    """What it puts out continues the streams, is flagged, and ends at rest."""
    program = a_program(1e6)
    role, plant = GeneratorRole(program, 1000, 100), PlantRole(MotorParameters(), 1, program)
    for _ in range(12):
        block = role.next_block()
        assert block is not None
        before = plant.process(block)
    assert plant.is_voltage_on
    last, voltage = {one.stream: one for one in before.blocks}, plant.voltage
    for after in plant.ramp_down().blocks:
        previous = last[after.stream]
        assert after.first_index == previous.end_index == plant.consumed
        assert after.sequence == previous.sequence + 1
        assert after.flags & SampleFlag.RAMPED_DOWN
        assert len(after.samples) <= STOP_TIME * 1e6
        if after.stream == "drive/voltage_monitor":
            steepest = np.abs(np.diff(previous.samples)).max()
            assert np.abs(np.diff(after.samples)).max() < steepest, "the monitor's filter follows"
            assert np.abs(np.diff(after.samples[100:])).max() < 0.05, "80 V in 10 000 samples"
            assert abs(after.samples[-100:].mean()) < 0.1, "zero, but for the monitor's offset"
            assert abs(after.samples[0] - voltage) < 10 * steepest, "the monitor is late"
    assert plant.voltage == 0.0, "what the operator is shown"


def test_voltage_is_off_before_and_after_a_program() -> None:
    program = a_program(1e6)
    role, plant = GeneratorRole(program, 1000, 1), PlantRole(MotorParameters(), 1, program)
    assert not plant.is_voltage_on
    while (block := role.next_block()) is not None:
        plant.process(block)
        role.acknowledge(plant.consumed)
        assert plant.is_voltage_on is (plant.consumed < program.length)
