"""The bag of a run, being read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imotor_ros.bag.facts import StreamCounts, stream_counts
from imotor_ros.bag.message_bag import BagMessage, MessageBag
from imotor_ros.contracts.blocks import SampleBlock, StreamLedger
from imotor_ros.contracts.messages import (
    block_from_message,
    channel_from_message,
    performance_from_message,
    program_from_message,
)
from imotor_ros.contracts.topics import CHANNELS, DRIVE_PROGRAM, DRIVE_VOLTAGE, PERFORMANCE
from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.indicators import Performance
from imotor_ros.errors import SamplesLostError, UnreadableFileError

__all__ = ["BagMessage", "RunBag"]

_BLOCK = DRIVE_VOLTAGE.type_name


class RunBag(MessageBag):
    """The bag of one run; see `MessageBag`, to which it adds what the messages mean."""

    @cached_property
    def program(self) -> DriveProgram:
        """
        What was played: the last program, because a cancelled run has a second, shorter one.

        Raises
        ------
        UnreadableFileError
            If the bag holds none.

        """
        return program_from_message(self._last(DRIVE_PROGRAM.name))

    @cached_property
    def performance(self) -> Performance:
        """
        The last performance that was published in the run.

        Raises
        ------
        UnreadableFileError
            If the bag holds none.

        """
        return performance_from_message(self._last(PERFORMANCE.name))

    @cached_property
    def channels(self) -> dict[str, ChannelDescription]:
        """The measured channels by name."""
        messages = map(self.decode, self.messages(CHANNELS.name))
        return {m.name: channel_from_message(m) for m in messages}

    def blocks(self, *streams: str) -> Iterator[SampleBlock]:
        """
        Yield blocks of samples in the order of the bag.

        Parameters
        ----------
        *streams : str
            Names of the streams wanted; none for all.

        """
        wanted = streams or tuple(n for n, kind in self.topics.items() if kind == _BLOCK)
        if wanted:
            for message in self.messages(*wanted):
                yield _own_samples(block_from_message(self.decode(message)))

    def samples(
        self, stream: str, *, allow_gaps: bool = False
    ) -> tuple[NDArray[np.float64], float, int]:
        """
        Return all samples of a stream, their rate (Hz) and the index of the first.

        Parameters
        ----------
        stream : str
            Name of the stream.
        allow_gaps : bool
            Whether missing samples are filled with NaN.

        Raises
        ------
        BadInputError
            If the bag has no such stream.
        SamplesLostError
            If samples are missing between others and `allow_gaps` is False.

        """
        parts: list[NDArray[np.float64]] = []
        rate, first, end = 0.0, 0, 0
        for block in self.blocks(stream):
            if not parts:
                rate, first, end = block.sample_rate, block.first_index, block.first_index
            if block.first_index != end:
                if not allow_gaps or block.first_index < end:
                    raise SamplesLostError(stream, end, block.first_index)
                parts.append(np.full(block.first_index - end, np.nan))
            parts.append(block.samples)
            end = block.end_index
        return np.concatenate(parts or [np.empty(0)]), rate, first

    @cached_property
    def stream_counts(self) -> StreamCounts:
        """What came of each stream; counted anew if the bag was not closed."""
        if self.facts.streams is not None and not self.damage:
            return self.facts.streams
        ledgers = {n: StreamLedger(n) for n, kind in self.topics.items() if kind == _BLOCK}
        for block in self.blocks():
            with suppress(SamplesLostError):
                ledgers[block.stream].accept(block)
        return stream_counts(ledgers, {})

    def _last(self, topic: str) -> Any:
        last = None
        for message in self.messages(topic) if topic in self.topics else ():
            last = message
        if last is None:
            raise UnreadableFileError(f"holds no message on {topic}", where=str(self.path))
        return self.decode(last)


def _own_samples(block: SampleBlock) -> SampleBlock:
    """Return the block with samples of its own: aligned and writable, as those from a topic."""
    return replace(block, samples=np.array(block.samples, dtype=np.float64))
