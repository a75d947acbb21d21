"""What lies inside a chunk of an MCAP file, whole or cut off."""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress

from backports import zstd

_CHUNK_HEAD = struct.Struct("<QQQI")
_PIECE = 1 << 16


class DamageError(Exception):
    """The content does not go on as it should; what came before is good."""


def text_at(content: memoryview, place: int) -> tuple[str, int]:
    """Return the text at a place, and the place after it."""
    (length,) = struct.unpack_from("<I", content, place)
    end = place + 4 + length
    if end > len(content):
        raise DamageError("a text reaches beyond its record")
    return bytes(content[place + 4 : end]).decode(), end


def unpacked(content: memoryview, is_whole: bool) -> memoryview:
    """Return the records of a chunk; of one that is cut off, those that are there."""
    try:
        _, _, size, checksum = _CHUNK_HEAD.unpack_from(content)
        compression, place = text_at(content, _CHUNK_HEAD.size)
        data = content[place + 8 :]
        if compression not in ("", "zstd"):
            raise DamageError(f"compression {compression!r} is not known")
        if not is_whole:
            return memoryview(_start_of(data)) if compression else data
        records = memoryview(zstd.decompress(data)) if compression else data
    except (struct.error, DamageError, UnicodeDecodeError, zstd.ZstdError) as error:
        if not is_whole:
            return memoryview(b"")
        raise DamageError(f"a chunk does not unpack ({error})") from error
    if len(records) != size or (checksum and zlib.crc32(records) != checksum):
        raise DamageError("a chunk has the wrong size or checksum")
    return records


def _start_of(data: memoryview) -> bytes:
    """Return as much as can be decompressed of a frame that is cut off or bad."""
    decompressor = zstd.ZstdDecompressor()
    start = b""
    with suppress(zstd.ZstdError, EOFError):
        for place in range(0, len(data), _PIECE):
            start += decompressor.decompress(data[place : place + _PIECE])
    return start
