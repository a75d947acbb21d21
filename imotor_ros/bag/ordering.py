"""
The log time of every message of a run, and the order in which they go into the bag.

On the virtual stand both follow from the messages alone, not from when they arrived: the same
seed gives the same bag however the messages of different topics overtook each other.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from imotor_ros.contracts.topics import ALL_TOPICS, CHANNELS, Intent

DEFAULT_PENDING_LIMIT = 256 * 2**20
"""Bytes held back at most: four seconds of eight streams at 1 MS/s."""

_NEVER = 2**63

_RANKS = {topic.name: rank for rank, topic in enumerate(ALL_TOPICS)}
_TIMED = {topic.name for topic in ALL_TOPICS if topic.intent is not Intent.STATUS}


@dataclass(frozen=True)
class OrderedMessage:
    """
    A message that may go into the bag now.

    Attributes
    ----------
    topic : str
        Name of its topic, as in `imotor_ros.contracts.topics`.
    data : bytes
        The serialised message.
    time : int
        Log time (ns since 1970), larger than that of every message before.

    """

    topic: str
    data: bytes
    time: int


class MessageOrder:
    """
    Gives messages their log times and lets them go in that order.

    A message whose time is that of the run (all but the diagnostics) gets an even log time: its
    own time, plus twice the rank of its topic in `ALL_TOPICS`, later if that one is taken. It
    leaves when no message with an earlier time can come any more. Messages whose time is that
    of a clock, and any that come too late for their place, get odd log times after the last
    even one: they fill gaps and never move a message of the run.

    For a run on hardware the log time is the time of reception, made increasing; every message
    leaves at once.

    Parameters
    ----------
    awaited : iterable of str
        Topics to wait for: as long as one of them may still bring an earlier message, no later
        one leaves. Each must bring its messages in the order of their times.
    counts : mapping of str to int, optional
        Topics of which so many messages must have come before anything leaves, e.g. the five
        descriptions on "channels", whose times are all that of sample 0.
    is_simulated : bool
        False for a run on hardware.
    pending_limit : int
        Most bytes held back. Beyond it the topics that hold the others back are not waited for
        any longer; see `given_up`.

    """

    def __init__(
        self,
        awaited: Iterable[str],
        counts: Mapping[str, int] | None = None,
        *,
        is_simulated: bool = True,
        pending_limit: int = DEFAULT_PENDING_LIMIT,
    ) -> None:
        self.given_up: list[str] = []
        self.late_count = 0
        self.pending_bytes = 0
        self.is_simulated = is_simulated
        self._limit = pending_limit
        self._ends: dict[str, int | None] = dict.fromkeys(awaited)
        self._missing = {name: count for name, count in (counts or {}).items() if count > 0}
        self._held: list[tuple[int, int, bytes, int, str, bytes]] = []
        self._loose: deque[tuple[str, bytes, int]] = deque()
        self._arrivals = 0
        self._bound: int | None = None
        self._last_even: int | None = None
        self._last_odd: int | None = None

    @property
    def watermark(self) -> int | None:
        """Time (ns) before which every awaited message has come; None before the first."""
        ends = [end for end in self._ends.values() if end is not None]
        if self._missing or len(ends) < len(self._ends):
            return None
        return min(ends, default=None)

    def add(self, topic: str, data: bytes, time: int, end: int | None = None) -> None:
        """
        Take a message.

        Parameters
        ----------
        topic : str
            Name of its topic.
        data : bytes
            The serialised message.
        time : int
            Time in its header (ns since 1970); for a run on hardware the time of reception.
        end : int, optional
            No later message of the topic has an earlier time than this, e.g. the time of the
            end of a block; by default `time`.

        """
        self.pending_bytes += len(data)
        self._arrivals += 1
        slot = time - time % 2 + 2 * _RANKS.get(topic, 0)
        if not self.is_simulated or topic not in _TIMED:
            self._loose.append((topic, data, time))
        elif self._bound is not None and slot < self._bound:
            self.late_count += 1
            self._loose.append((topic, data, time))
        else:
            # several instruments publish on channels: there the content decides, not the arrival
            tie = data if topic == CHANNELS.name else b""
            held = (slot, _RANKS[topic], tie, self._arrivals, topic, data)
            heapq.heappush(self._held, held)
        self._note(topic, time if end is None else end)

    def promise(self, topic: str, end: int) -> None:
        """Take note that no message of an awaited topic has an earlier time than `end` (ns)."""
        if topic in self._ends:
            known = self._ends[topic]
            self._ends[topic] = end if known is None else max(known, end)

    def _note(self, topic: str, end: int) -> None:
        self.promise(topic, end)
        if topic in self._missing:
            self._missing[topic] -= 1
            if not self._missing[topic]:
                del self._missing[topic]

    def ready(self) -> Iterator[OrderedMessage]:
        """Yield the messages that may leave now."""
        if not self.is_simulated:
            yield from self._in_order_of_arrival()
            return
        if self.pending_bytes > self._limit:
            self._give_up()
        self._raise_bound()
        yield from self._timed()
        yield from self._untimed()

    def flush(self) -> Iterator[OrderedMessage]:
        """Yield all that is left; what comes later is late."""
        self._ends.clear()
        self._missing.clear()
        if self.is_simulated:
            self._bound = _NEVER
            yield from self._timed()
            yield from self._untimed()
        else:
            yield from self._in_order_of_arrival()

    def _raise_bound(self) -> None:
        if self._missing:
            return
        if not self._ends:  # nothing to wait for
            self._bound = max([self._bound or 0, *(slot + 2 for slot, *_ in self._held)])
        elif (mark := self.watermark) is not None:
            self._bound = max(self._bound or 0, mark - mark % 2)

    def _timed(self) -> Iterator[OrderedMessage]:
        while self._held and self._bound is not None and self._held[0][0] < self._bound:
            slot, _, _, _, topic, data = heapq.heappop(self._held)
            if self._last_even is not None:
                slot = max(slot, self._last_even + 2)
            self._last_even = slot
            yield self._leaving(topic, data, slot)

    def _untimed(self) -> Iterator[OrderedMessage]:
        while self._loose and self._bound is not None:
            topic, data, time = self._loose[0]
            slot = time | 1 if self._last_even is None else self._last_even + 1
            if self._last_odd is not None:
                slot = max(slot, self._last_odd + 2)
            if self._last_even is None and self._bound < _NEVER:
                return
            # the next even log time can be this one
            if slot > max(self._bound, (self._last_even or 0) + 2):
                return
            self._loose.popleft()
            self._last_odd = slot
            yield self._leaving(topic, data, slot)

    def _in_order_of_arrival(self) -> Iterator[OrderedMessage]:
        while self._loose:
            topic, data, time = self._loose.popleft()
            if self._last_even is not None:
                time = max(time, self._last_even + 1)
            self._last_even = time
            yield self._leaving(topic, data, time)

    def _leaving(self, topic: str, data: bytes, time: int) -> OrderedMessage:
        self.pending_bytes -= len(data)
        return OrderedMessage(topic, data, time)

    def _give_up(self) -> None:
        lagging = [*self._missing, *(name for name, end in self._ends.items() if end is None)]
        if not lagging:
            lagging = [name for name, end in self._ends.items() if end == self.watermark]
        for name in lagging:
            self._missing.pop(name, None)
            self._ends.pop(name, None)
        self.given_up += lagging
