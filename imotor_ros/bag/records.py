"""
MCAP files, read record by record, whole or damaged.

A record is an opcode (1 byte), a length (8 bytes) and its content; numbers are little-endian.
After a magic and a header come schemas, channels and chunks, each chunk a sequence of records
of its own; a summary and a footer end the file (https://mcap.dev/spec). A killed writer leaves
all but the end, so what a damaged file still holds is found from its start.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from imotor_ros.bag.chunks import DamageError, text_at, unpacked
from imotor_ros.errors import UnreadableFileError

MAGIC = b"\x89MCAP0\r\n"

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06
_CHUNK_INDEX, _STATISTICS, _METADATA_INDEX, _DATA_END = 0x08, 0x0B, 0x0D, 0x0F
_FRAME = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_FOOTER_SIZE = _FRAME.size + 20 + len(MAGIC)


@dataclass(frozen=True)
class StoredChannel:
    """
    One topic of a file.

    Attributes
    ----------
    topic, type_name : str
        Absolute name of the topic, and its message type.
    definition, encoding : str
        The type's definition, and its form: "ros2msg" for that of .msg files.

    """

    topic: str
    type_name: str
    definition: str
    encoding: str


@dataclass(frozen=True)
class StoredMessage:
    """A message: number of its channel, log time (ns since 1970) and content."""

    channel: int
    time: int
    data: memoryview


class McapFile:
    """
    An MCAP file, open for reading.

    Attributes
    ----------
    channels : dict of int to StoredChannel
        Channels by number; in a damaged file, those found so far.
    metadata : str
        The copy of metadata.yaml that a whole file holds.
    counts : dict of int to int
        Messages by channel, for a whole file.
    times : tuple of int
        Log times (ns since 1970) of the first and the last message of a whole file.

    Raises
    ------
    UnreadableFileError
        If the file cannot be read, or is no MCAP file.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._end_damage = ""
        self._damage_inside: list[str] = []
        self.channels: dict[int, StoredChannel] = {}
        self.metadata = ""
        self.counts: dict[int, int] = {}
        self.times = (0, 0)
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._chunks: list[tuple[int, frozenset[int]]] = []
        try:
            self._stream = path.open("rb")
            self.size = os.fstat(self._stream.fileno()).st_size
            magic = self._read(0, len(MAGIC))
        except OSError as error:
            cause = error.strerror or str(error)
            raise UnreadableFileError(f"cannot be read ({cause})", where=str(path)) from error
        if magic != MAGIC[: len(magic)]:
            self._stream.close()
            raise UnreadableFileError("is not an MCAP file", where=str(path))
        self._read_end()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    @property
    def damage(self) -> str:
        """
        What is wrong with the file; empty if its end is as it should be.

        Reading the messages of a damaged file adds what is found on the way.
        """
        return "; ".join([self._end_damage, *self._damage_inside]) if self._end_damage else ""

    def distrust(self, reason: str) -> None:
        """Find messages from the file's start on, as if its end were damaged."""
        self._end_damage = reason

    def messages(self, channels: Collection[int] | None = None) -> Iterator[StoredMessage]:
        """
        Yield the messages in the order of the file.

        Parameters
        ----------
        channels : collection of int, optional
            Channels wanted; by default all.

        Raises
        ------
        UnreadableFileError
            If a file whose end is whole is damaged inside.

        """
        found = self._scan() if self.damage else self._indexed(channels)
        for message in found:
            if channels is None or message.channel in channels:
                yield message

    def _indexed(self, channels: Collection[int] | None) -> Iterator[StoredMessage]:
        for offset, held in self._chunks:
            if channels is None or held.intersection(channels):
                _, length = _FRAME.unpack(self._read(offset, _FRAME.size))
                try:
                    yield from self._in_chunk(self._read(offset + _FRAME.size, length), True)
                except DamageError as error:
                    what = f"is damaged at byte {offset} ({error})"
                    raise UnreadableFileError(what, where=str(self.path)) from error

    def _scan(self) -> Iterator[StoredMessage]:
        """Yield what can be read from the start on; a bad chunk is passed over."""
        self._damage_inside.clear()
        offset = len(MAGIC)
        while True:
            frame = self._read(offset, _FRAME.size)
            if len(frame) < _FRAME.size:
                self._note_damage(offset, "the file ends")
                return
            kind, length = _FRAME.unpack(frame)
            if kind in (_DATA_END, _FOOTER):
                return
            is_whole = offset + _FRAME.size + length <= self.size
            if kind == 0 or (not is_whole and kind != _CHUNK):
                self._note_damage(offset, "no whole record")
                return
            if kind in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK):
                content = self._read(offset + _FRAME.size, min(length, self.size))
                try:
                    yield from self._in_record(kind, memoryview(content), is_whole)
                except DamageError as error:
                    self._note_damage(offset, str(error))
            if not is_whole:
                self._note_damage(offset, "the file ends within a chunk")
                return
            offset += _FRAME.size + length

    def _note_damage(self, offset: int, what: str) -> None:
        self._damage_inside.append(f"byte {offset}: {what}")

    def _read(self, offset: int, length: int) -> bytes:
        self._stream.seek(offset)
        return self._stream.read(length)

    # ---- records -----------------------------------------------------------------------------

    def _in_record(self, kind: int, content: memoryview, is_whole: bool) -> Iterator[StoredMessage]:
        """Take in one record; yield the messages in it."""
        try:
            if kind == _SCHEMA:
                self._take_schema(content)
            elif kind == _CHANNEL:
                self._take_channel(content)
            elif kind == _CHUNK:
                yield from self._in_chunk(content, is_whole)
            elif kind == _MESSAGE:
                channel, _, time, _ = _MESSAGE_HEAD.unpack_from(content)
                if channel not in self.channels:
                    raise DamageError(f"a message of the unknown channel {channel}")
                yield StoredMessage(channel, time, content[_MESSAGE_HEAD.size :])
        except (struct.error, UnicodeDecodeError, KeyError) as error:
            raise DamageError(f"a record does not parse ({error})") from error

    def _in_chunk(self, content: bytes | memoryview, is_whole: bool) -> Iterator[StoredMessage]:
        records = unpacked(memoryview(content), is_whole)
        place = 0
        while place + _FRAME.size <= len(records):
            kind, length = _FRAME.unpack_from(records, place)
            place += _FRAME.size
            if place + length > len(records):
                if is_whole:
                    raise DamageError("a record reaches beyond its chunk")
                return
            yield from self._in_record(kind, records[place : place + length], True)
            place += length

    def _take_schema(self, content: memoryview) -> None:
        (number,) = struct.unpack_from("<H", content)
        name, place = text_at(content, 2)
        encoding, place = text_at(content, place)
        definition, _ = text_at(content, place)
        self._schemas[number] = (name, encoding, definition)

    def _take_channel(self, content: memoryview) -> None:
        number, schema = struct.unpack_from("<HH", content)
        topic, _ = text_at(content, 4)
        name, encoding, definition = self._schemas[schema]
        self.channels[number] = StoredChannel(topic, name, definition, encoding)

    # ---- end of the file ---------------------------------------------------------------------

    def _read_end(self) -> None:
        footer = self._read(max(0, self.size - _FOOTER_SIZE), _FOOTER_SIZE)
        if len(footer) < _FOOTER_SIZE or footer[-len(MAGIC) :] != MAGIC or footer[0] != _FOOTER:
            self._end_damage = "its end is missing"
            return
        (start,) = struct.unpack_from("<Q", footer, _FRAME.size)
        try:
            for kind, content in self._summary(start):
                self._take_summary(kind, content)
        except (DamageError, struct.error, UnicodeDecodeError, KeyError) as error:
            self._end_damage = f"its index does not parse ({error})"

    def _summary(self, start: int) -> Iterator[tuple[int, memoryview]]:
        if not 0 < start < self.size:
            raise DamageError("none there")
        summary = memoryview(self._read(start, self.size - start))
        place = 0
        while place < len(summary):
            kind, length = _FRAME.unpack_from(summary, place)
            if kind == _FOOTER:
                return
            place += _FRAME.size + length
            yield kind, summary[place - length : place]

    def _take_summary(self, kind: int, content: memoryview) -> None:
        if kind == _CHUNK_INDEX:
            offset, _, size = struct.unpack_from("<QQI", content, 16)
            held = (struct.unpack_from("<H", content, 36 + i)[0] for i in range(0, size, 10))
            self._chunks.append((offset, frozenset(held)))
        elif kind == _STATISTICS:
            self.times = struct.unpack_from("<QQ", content, 26)
            pairs = struct.iter_unpack("<HQ", content[46 : 46 + (len(content) - 46) // 10 * 10])
            self.counts = dict(pairs)
        elif kind == _METADATA_INDEX:
            offset, length = struct.unpack_from("<QQ", content)
            self._take_metadata(memoryview(self._read(offset, length))[_FRAME.size :])
        elif kind in (_SCHEMA, _CHANNEL):
            for _ in self._in_record(kind, content, True):
                pass

    def _take_metadata(self, content: memoryview) -> None:
        name, place = text_at(content, 0)
        place += 4
        while name == "rosbag2" and place < len(content):
            key, place = text_at(content, place)
            value, place = text_at(content, place)
            if key == "serialized_metadata":
                self.metadata = value
