"""Everything that goes into a message comes out of it the same, whoever made the classes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imotor_ros.contracts import messages, topics
from imotor_ros.contracts.blocks import SampleBlock
from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.core.indicators import UNITS, Indicator, Performance, StreamCount, Window
from imotor_ros.errors import BadInputError

EPOCH = 946_684_800 * 10**9 + 123_456_789

BLOCK = SampleBlock(
    stream="slider/velocity",
    run_id="run-1",
    time=EPOCH,
    sequence=2**40,
    first_index=2**45,
    sample_rate=1e6,
    unit="m/s",
    flags=int(SampleFlag.OVER_RANGE | SampleFlag.GAP),
    samples=np.array([0.0, -0.0, 5e-324, -1.7976931348623157e308, math.inf, 0.1]),
)
PROGRAM = DriveProgram(
    run_id="run-1",
    epoch=EPOCH,
    sample_rate=1e6,
    fundamental_frequency=4625.0,
    segments=(
        DriveSegment("bias", 5_000, 0.0, 0.0, 0.0, 50.0, (0.0, 0.0), (0.0, 0.0), (0.1, 0.2)),
        DriveSegment("sweep", 2**40, 1e3, 9e3, 50.0, 0.0, (1.0, 2.0), (0.0, 0.0), (0.1, 0.2)),
        DriveSegment("off", 1, 0.0, 0.0),
    ),
    motion_amplitudes=(6e-6, 1e-6),
    motion_phases=(0.0, -1.5),
)
CHANNEL = ChannelDescription(
    "rod/velocity", "velocity", "m/s", 1.25, 3e-5, 0.01, 2e-4, 5e-7, 1e5, 0.5, 6.8e-6,
    "virtual vibrometer", "0815", is_simulated=False,
)  # fmt: skip
PERFORMANCE = Performance(
    run_id="run-1",
    is_final=True,
    indicators=(
        Indicator("mean_velocity", "m/s", 0.1, 0.001),
        Indicator("force", "N", reason="the slider met no stop"),
    ),
    streams=(StreamCount("rod/velocity", 2**40, 3, 33), StreamCount("load/force", 0, 0)),
    end_index=2**40,
    windows=(Window("free_run", 100, 200, 5),),
    delays=(("rod/velocity", 6.8e-6), ("load/force", 0.0)),
    warnings=("one", "two: µm"),
)


def same(a: Any, b: Any) -> bool:
    """Whether two objects are equal to the last bit, NaN and the sign of zero included."""
    return repr(a) == repr(b)


def through_bytes(types: Any, message: Any, type_name: str) -> Any:
    """Return a message after serialisation and back, by the classes' own means."""
    if hasattr(types, "serialize"):
        return types.deserialize(types.serialize(message), type_name)
    from rclpy.serialization import deserialize_message, serialize_message

    return deserialize_message(serialize_message(message), type(message))


def test_block_round_trip(types: Any) -> None:
    message = messages.block_to_message(types, BLOCK)
    for one in (message, through_bytes(types, message, topics.ROD_VELOCITY.type_name)):
        found = messages.block_from_message(one)
        assert same(replace(found, samples=None), replace(BLOCK, samples=None))  # type: ignore[arg-type]
        assert found.samples.dtype == np.float64
        assert found.samples.tobytes() == BLOCK.samples.tobytes()
        assert messages.message_time(one) == EPOCH


def test_empty_block_and_block_of_strided_samples(types: Any) -> None:
    for samples in (np.empty(0), np.arange(10.0)[::3], np.arange(4, dtype=np.float32)):
        message = messages.block_to_message(types, replace(BLOCK, samples=samples))
        assert np.array_equal(messages.block_from_message(message).samples, samples)


def test_block_of_a_message_is_a_view_of_it() -> None:
    """Live, 80 kB are not copied for each reader."""
    pytest.importorskip("imotor_msgs", reason="needs the interface package")
    from imotor_ros.nodes.message_types import RclpyTypes

    message = messages.block_to_message(RclpyTypes(), BLOCK)
    assert np.shares_memory(messages.block_from_message(message).samples, message.samples)


def test_program_round_trip(types: Any) -> None:
    message = messages.program_to_message(types, PROGRAM)
    assert message.length == PROGRAM.length
    again = through_bytes(types, message, topics.DRIVE_PROGRAM.type_name)
    for one in (message, again):
        assert same(messages.program_from_message(one), PROGRAM)


def test_bad_program_in_a_message_is_refused(types: Any) -> None:
    message = messages.program_to_message(types, PROGRAM)
    message.segments = []
    with pytest.raises(BadInputError, match="drive program run-1: has no segments"):
        messages.program_from_message(message)
    message = messages.program_to_message(types, PROGRAM)
    message.segments[0].start_offset = math.nan
    with pytest.raises(BadInputError, match="bias: is not finite"):
        messages.program_from_message(message)


def test_channel_round_trip(types: Any) -> None:
    message = messages.channel_to_message(types, CHANNEL, "run-1", EPOCH)
    again = through_bytes(types, message, topics.CHANNELS.type_name)
    for one in (message, again):
        assert messages.channel_from_message(one) == CHANNEL
        assert (one.run_id, messages.message_time(one)) == ("run-1", EPOCH)


def test_performance_round_trip(types: Any) -> None:
    message = messages.performance_to_message(types, PERFORMANCE, EPOCH)
    again = through_bytes(types, message, topics.PERFORMANCE.type_name)
    for one in (message, again):
        assert same(messages.performance_from_message(one), PERFORMANCE)
        assert [indicator.is_available for indicator in one.indicators] == [True, False]


def test_performance_of_nothing_round_trip(types: Any) -> None:
    empty = Performance("", False, (), (), 0)
    message = messages.performance_to_message(types, empty, 0)
    assert messages.performance_from_message(message) == empty


def test_short_messages_hold_what_they_are_given(types: Any) -> None:
    progress = messages.progress_to_message(types, "run-1", EPOCH, 2**40, 5, "plant: gap")
    assert (progress.consumed, progress.flags, progress.fault) == (2**40, 5, "plant: gap")
    info = messages.run_info_to_message(types, "run-1", EPOCH, '{"seed": 1}')
    assert (info.run_id, info.json) == ("run-1", '{"seed": 1}')
    state = messages.recording_to_message(
        types, "run-1", EPOCH, 3, "/bag", messages=7, lost=2, error="disk full"
    )
    assert (state.state, state.path, state.error) == (3, "/bag", "disk full")
    assert (state.messages, state.lost) == (7, 2)
    for one, name in ((progress, "DriveProgress"), (info, "RunInfo"), (state, "RecordingState")):
        again = through_bytes(types, one, f"imotor_msgs/msg/{name}")
        assert messages.message_time(again) == EPOCH
        assert again.run_id == "run-1"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(time=st.integers(0, 2**31 * 10**9 - 1))
def test_time_in_a_header_is_exact(types: Any, time: int) -> None:
    message = messages.block_to_message(types, replace(BLOCK, time=time))
    assert messages.message_time(message) == time


def test_numbers_of_numpy_go_into_messages(types: Any) -> None:
    """Field by field they would raise, or be sent as other numbers."""
    block = replace(
        BLOCK, flags=np.uint32(5), sample_rate=np.float64(1e6), sequence=0, first_index=0
    )
    message = messages.block_to_message(types, block)
    assert messages.block_from_message(message).flags == 5
    count = StreamCount("rod/velocity", np.int64(3), np.int64(0), SampleFlag.GAP)
    window = Window("load", np.int64(1), np.int64(2), np.int64(3))
    indicator = Indicator("force", UNITS["force"], np.float64(1.0), np.float64(0.1))
    performance = Performance("r", False, (indicator,), (count,), np.int64(9), (window,))
    through = through_bytes(
        types,
        messages.performance_to_message(types, performance, EPOCH),
        topics.PERFORMANCE.type_name,
    )
    assert messages.performance_from_message(through).streams[0].flags == 32


def test_flags_are_those_of_the_message_definition() -> None:
    pytest.importorskip("imotor_msgs", reason="needs the interface package")
    from imotor_ros.nodes.message_types import message_class

    kind = message_class(topics.ROD_VELOCITY.type_name)
    for flag in SampleFlag:
        assert getattr(kind, f"FLAG_{flag.name}") == flag
