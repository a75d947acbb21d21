"""
From objects to ROS messages and back, for whoever brings the message classes.

The same functions serve `rclpy` classes (which want `array.array`) and those that `rosbags`
makes from the definitions (which want NumPy arrays): both take their fields as keywords.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from imotor_ros.contracts.blocks import NANOSECONDS, SampleBlock
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram, DriveSegment, Ending
from imotor_ros.core.indicators import Indicator, Performance, StreamCount, Window


class MessageTypes(Protocol):
    """Where message classes come from."""

    def message(self, type_name: str, **fields: Any) -> Any:
        """Return a message of the type, e.g. "imotor_msgs/msg/SampleBlock", with its fields."""

    def floats(self, values: NDArray[np.float64] | Sequence[float]) -> Any:
        """Return what a float64[] field wants."""


def _header(types: MessageTypes, time: int, frame: str = "") -> Any:
    seconds, nanoseconds = divmod(time, NANOSECONDS)
    stamp = types.message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return types.message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def message_time(message: Any) -> int:
    """Return the time (ns since 1970) in a message's header."""
    stamp = message.header.stamp
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def block_to_message(types: MessageTypes, block: SampleBlock) -> Any:
    """Return a SampleBlock message."""
    return types.message(
        "imotor_msgs/msg/SampleBlock",
        header=_header(types, block.time, block.stream),
        run_id=block.run_id,
        sequence=block.sequence,
        first_index=block.first_index,
        sample_rate=float(block.sample_rate),
        unit=block.unit,
        flags=int(block.flags),
        samples=types.floats(block.samples),
    )


def block_from_message(message: Any) -> SampleBlock:
    """Return the block of a SampleBlock message; its samples are a view of the message's."""
    return SampleBlock(
        stream=message.header.frame_id,
        run_id=message.run_id,
        time=message_time(message),
        sequence=int(message.sequence),
        first_index=int(message.first_index),
        sample_rate=float(message.sample_rate),
        unit=message.unit,
        flags=int(message.flags),
        samples=np.asarray(message.samples, dtype=np.float64),
    )


def program_to_message(types: MessageTypes, program: DriveProgram) -> Any:
    """Return a DriveProgram message."""
    return types.message(
        "imotor_msgs/msg/DriveProgram",
        header=_header(types, program.epoch, "drive/program"),
        run_id=program.run_id,
        sample_rate=float(program.sample_rate),
        length=program.length,
        fundamental_frequency=float(program.fundamental_frequency),
        motion_amplitudes=types.floats(program.motion_amplitudes),
        motion_phases=types.floats(program.motion_phases),
        segments=[_segment_to_message(types, segment) for segment in program.segments],
        ending=int(program.ending),
    )


def _segment_to_message(types: MessageTypes, segment: DriveSegment) -> Any:
    return types.message(
        "imotor_msgs/msg/DriveSegment",
        label=segment.label,
        length=segment.length,
        start_frequency=float(segment.start_frequency),
        end_frequency=float(segment.end_frequency),
        start_offset=float(segment.start_offset),
        end_offset=float(segment.end_offset),
        start_amplitudes=types.floats(segment.start_amplitudes),
        end_amplitudes=types.floats(segment.end_amplitudes),
        phases=types.floats(segment.phases),
    )


def program_from_message(message: Any) -> DriveProgram:
    """
    Return the program of a DriveProgram message.

    Raises
    ------
    BadInputError
        If it is not a program that can be played.

    """
    return DriveProgram(
        run_id=message.run_id,
        epoch=message_time(message),
        sample_rate=float(message.sample_rate),
        fundamental_frequency=float(message.fundamental_frequency),
        segments=tuple(_segment_from_message(segment) for segment in message.segments),
        motion_amplitudes=_floats(message.motion_amplitudes),
        motion_phases=_floats(message.motion_phases),
        ending=Ending(getattr(message, "ending", Ending.PLANNED)),  # older bags have none
    )


def _segment_from_message(message: Any) -> DriveSegment:
    return DriveSegment(
        label=message.label,
        length=int(message.length),
        start_frequency=float(message.start_frequency),
        end_frequency=float(message.end_frequency),
        start_offset=float(message.start_offset),
        end_offset=float(message.end_offset),
        start_amplitudes=_floats(message.start_amplitudes),
        end_amplitudes=_floats(message.end_amplitudes),
        phases=_floats(message.phases),
    )


def _floats(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


_CHANNEL_NUMBERS = (
    "range",
    "resolution",
    "gain_uncertainty",
    "offset_uncertainty",
    "noise_density",
    "bandwidth",
    "high_pass_frequency",
    "delay",
)
_CHANNEL_TEXTS = ("name", "quantity", "unit", "instrument", "serial", "low_pass")


def channel_to_message(
    types: MessageTypes, channel: ChannelDescription, run_id: str, epoch: int
) -> Any:
    """Return a Channel message for a run whose sample 0 is at `epoch` (ns since 1970)."""
    return types.message(
        "imotor_msgs/msg/Channel",
        header=_header(types, epoch, channel.name),
        run_id=run_id,
        is_simulated=bool(channel.is_simulated),
        **{key: float(getattr(channel, key)) for key in _CHANNEL_NUMBERS},
        **{key: str(getattr(channel, key)) for key in _CHANNEL_TEXTS},
    )


def channel_from_message(message: Any) -> ChannelDescription:
    """Return the description in a Channel message."""
    fields: dict[str, Any] = {key: float(getattr(message, key)) for key in _CHANNEL_NUMBERS}
    fields.update({key: str(getattr(message, key)) for key in _CHANNEL_TEXTS})
    return ChannelDescription(is_simulated=bool(message.is_simulated), **fields)


def progress_to_message(
    types: MessageTypes, run_id: str, time: int, consumed: int, flags: int = 0, fault: str = ""
) -> Any:
    """Return a DriveProgress message; `time` is that of the next sample (ns since 1970)."""
    return types.message(
        "imotor_msgs/msg/DriveProgress",
        header=_header(types, time, "drive/progress"),
        run_id=run_id,
        consumed=consumed,
        flags=int(flags),
        fault=fault,
    )


def run_info_to_message(types: MessageTypes, run_id: str, epoch: int, json_text: str) -> Any:
    """Return a RunInfo message."""
    header = _header(types, epoch, "run/info")
    return types.message("imotor_msgs/msg/RunInfo", header=header, run_id=run_id, json=json_text)


def performance_to_message(types: MessageTypes, performance: Performance, time: int) -> Any:
    """Return a Performance message; `time` is that of the end of what it rests on (ns)."""
    return types.message(
        "imotor_msgs/msg/Performance",
        header=_header(types, time, "performance"),
        run_id=performance.run_id,
        is_final=performance.is_final,
        indicators=[_indicator_to_message(types, one) for one in performance.indicators],
        streams=[_count_to_message(types, one) for one in performance.streams],
        end_index=int(performance.end_index),
        windows=[_window_to_message(types, one) for one in performance.windows],
        delayed_channels=[name for name, _ in performance.delays],
        delays=types.floats([delay for _, delay in performance.delays]),
        warnings=list(performance.warnings),
    )


def _indicator_to_message(types: MessageTypes, indicator: Indicator) -> Any:
    return types.message(
        "imotor_msgs/msg/Indicator",
        name=indicator.name,
        unit=indicator.unit,
        is_available=not math.isnan(indicator.value),
        value=float(indicator.value),
        uncertainty=float(indicator.uncertainty),
        reason=indicator.reason,
    )


def _window_to_message(types: MessageTypes, window: Window) -> Any:
    return types.message(
        "imotor_msgs/msg/Window",
        name=window.name,
        start=int(window.start),
        end=int(window.end),
        periods=int(window.periods),
    )


def _count_to_message(types: MessageTypes, count: StreamCount) -> Any:
    return types.message(
        "imotor_msgs/msg/StreamCount",
        name=count.name,
        received=int(count.received),
        lost=int(count.lost),
        flags=int(count.flags),
    )


def performance_from_message(message: Any) -> Performance:
    """Return the performance in a Performance message."""
    return Performance(
        run_id=message.run_id,
        is_final=bool(message.is_final),
        indicators=tuple(
            Indicator(
                name=one.name,
                unit=one.unit,
                value=float(one.value),
                uncertainty=float(one.uncertainty),
                reason=one.reason,
            )
            for one in message.indicators
        ),
        streams=tuple(
            StreamCount(
                name=one.name,
                received=int(one.received),
                lost=int(one.lost),
                flags=int(one.flags),
            )
            for one in message.streams
        ),
        end_index=int(message.end_index),
        windows=tuple(
            Window(one.name, int(one.start), int(one.end), int(one.periods))
            for one in message.windows
        ),
        delays=tuple(zip(message.delayed_channels, _floats(message.delays), strict=True)),
        warnings=tuple(message.warnings),
    )


def recording_to_message(
    types: MessageTypes,
    run_id: str,
    epoch: int,
    state: int,
    path: str,
    *,
    messages: int = 0,
    lost: int = 0,
    error: str = "",
) -> Any:
    """Return a RecordingState message."""
    return types.message(
        "imotor_msgs/msg/RecordingState",
        header=_header(types, epoch, "recording"),
        run_id=run_id,
        state=state,
        path=path,
        messages=messages,
        lost=lost,
        error=error,
    )


def stand_state_to_message(
    types: MessageTypes,
    time: int,
    state: int,
    run_id: str = "",
    *,
    node: str = "",
    reason: str = "",
    sent: int = 0,
    consumed: int = 0,
) -> Any:
    """Return a StandState message of `time` (ns since 1970)."""
    return types.message(
        "imotor_msgs/msg/StandState",
        header=_header(types, time, "state"),
        state=state,
        run_id=run_id,
        node=node,
        reason=reason,
        sent=sent,
        consumed=consumed,
    )
