"""
What the recorder needs of a bag file beyond the public interface of `rosbags`.

`rosbags` 0.11 closes a chunk of an MCAP file when it holds 1 MiB, writes through Python's file
buffer and leaves half a chunk in the file where the disk is full. This module is all that knows
its inside: `Writer.STORAGE_PLUGINS`, and of `McapWriter` the attributes `bio`, `chunk`,
`compressor`, `channel_stats`, `message_end_time` and the method `close_chunk`.
"""

from __future__ import annotations

import errno
import fcntl
import os
import traceback
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any, cast

from backports import zstd
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

_ZSTD_OPTIONS: dict[int, int] = {
    zstd.CompressionParameter.compression_level: 1,
    zstd.CompressionParameter.checksum_flag: 1,
}


class _WholeWrites(FileIO):
    """A file without buffer that writes all it is given, or raises OSError."""

    def write(self, data: Any) -> int:
        """Write all bytes of `data`."""
        rest = memoryview(data).cast("B")
        count = len(rest)
        while rest:
            rest = rest[super().write(rest) :]
        return count


class RunStorage(McapWriter):
    """An MCAP file that holds whole chunks at all times, and is locked while it is written."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.bio.close()
        self.bio = cast("Any", _WholeWrites(self.path, "r+"))
        self.bio.seek(0, os.SEEK_END)
        lock(self.bio.fileno())
        if self.compression:
            self.compressor = _compress

    def write_definitions(self) -> None:
        """Write the schemas and channels added so far; they need not wait for a chunk."""
        self.bio.write(self.chunk.bio.getvalue())
        self.chunk.bio.seek(0)
        self.chunk.bio.truncate()

    @property
    def has_pending(self) -> bool:
        """Whether the open chunk holds messages."""
        return bool(self.chunk.msgs)

    def close_chunk(self) -> None:
        """Write the open chunk; where that fails the file is as it was before."""
        if os.fstat(self.bio.fileno()).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the file was removed", str(self.path))
        start = self.bio.tell()
        try:
            super().close_chunk()
        except OSError as error:
            # CPython up to 3.12.1 crashes when it collects a view of a BytesIO that a frame of
            # the traceback keeps
            traceback.clear_frames(error.__traceback__)
            self._cut(start)
            raise

    def close(self, version: int, metadata: str) -> None:
        """Write what ends the file and close it; where that fails the chunks remain."""
        start = self.bio.tell()
        try:
            super().close(version, metadata)
        except OSError as error:
            # CPython up to 3.12.1 crashes when it collects a view of a BytesIO that a frame of
            # the traceback keeps
            traceback.clear_frames(error.__traceback__)
            self._cut(start)
            raise

    def drop_chunk(self) -> None:
        """Forget the open chunk, which cannot be written."""
        for key, messages in self.chunk.msgs.items():
            self.channel_stats[key] -= len(messages)
        self.chunk.msgs.clear()
        self.chunk.bio.seek(0)
        self.chunk.bio.truncate()

    def _cut(self, size: int) -> None:
        with suppress(OSError):
            self.bio.seek(size)
            self.bio.truncate()


class RunBagWriter(Writer):
    """The bag writer of `rosbags` with `RunStorage` as its storage."""

    STORAGE_PLUGINS = {StoragePlugin.MCAP: RunStorage}  # noqa: RUF012

    def __init__(self, path: Path, *, is_compressed: bool) -> None:
        super().__init__(path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
        if is_compressed:
            self.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)

    @property
    def run_storage(self) -> RunStorage:
        """The file being written."""
        return cast("RunStorage", self.storage)

    def drop_chunk(self, last_time: int) -> None:
        """Forget the open chunk, which cannot be written; before it came `last_time` (ns)."""
        self.run_storage.drop_chunk()
        self.counts.update(self.run_storage.channel_stats)
        self.max_timestamp = self.run_storage.message_end_time = last_time


def _compress(data: bytes) -> bytes:
    return zstd.compress(data, options=_ZSTD_OPTIONS)


def lock(descriptor: int) -> bool:
    """Lock an open file against other writers; return False if one has it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def is_locked(path: Path) -> bool:
    """Return whether a file is being written."""
    with path.open("rb") as stream:
        try:
            fcntl.flock(stream.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # a file system without locks
            return False
        return False


def sync(path: Path) -> None:
    """Make a file or folder survive a power failure."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
