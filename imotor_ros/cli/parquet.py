"""
Tables as Parquet files, in the simplest form that the format allows.

One row group, one page per column, values as they are: no compression, no dictionary. Every
column may hold nulls. What reads Parquet reads this; see https://parquet.apache.org/docs for
the format, whose descriptions are in Thrift's compact protocol. A table of indicators is small,
and a library for it would be the largest of all that the package needs.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

Value = str | float | int | bool | None

_MAGIC = b"PAR1"

_BOOLEAN, _INT64, _DOUBLE, _BYTE_ARRAY = 0, 2, 5, 6
_OPTIONAL = 1
_UTF8 = 0
_PLAIN, _RLE = 0, 3
_UNCOMPRESSED = 0
_DATA_PAGE = 0
_CREATED_BY = "imotor_ros"


@dataclass(frozen=True)
class Column:
    """
    A named column.

    Attributes
    ----------
    name : str
        Its name.
    values : sequence
        Texts, truth values or numbers, all of one kind, or None. Whole numbers among other
        numbers are taken as numbers.

    """

    name: str
    values: Sequence[Value]

    @property
    def kind(self) -> int:
        """Physical type: that of the values, a number where there is none."""
        kinds = {type(value) for value in self.values if value is not None}
        if kinds == {bool}:
            return _BOOLEAN
        if kinds == {int}:
            return _INT64
        if str in kinds or bool in kinds:
            return _BYTE_ARRAY
        return _DOUBLE


def encode(columns: Sequence[Column]) -> bytes:
    """
    Return the bytes of a Parquet file.

    Parameters
    ----------
    columns : sequence of Column
        The table, at least one column; all of one length.

    """
    content = bytearray(_MAGIC)
    chunks = []
    for column in columns:
        page = _page(column)
        header = _page_header(len(column.values), len(page))
        chunks.append(_chunk(column, offset=len(content), size=len(header) + len(page)))
        content += header + page
    footer = _footer(columns, chunks, len(content) - len(_MAGIC))
    return bytes(content) + footer + struct.pack("<I", len(footer)) + _MAGIC


def _page(column: Column) -> bytes:
    """Return which values there are, by one bit each, and those values."""
    present = [value is not None for value in column.values]
    bits = _bits(present)
    levels = _varint(len(bits) << 1 | 1) + bits
    values = [value for value in column.values if value is not None]
    return struct.pack("<I", len(levels)) + levels + _plain(column.kind, values)


def _plain(kind: int, values: Sequence[Value]) -> bytes:
    if kind == _BOOLEAN:
        return _bits([bool(value) for value in values])
    if kind == _INT64:
        return struct.pack(f"<{len(values)}q", *values)
    if kind == _DOUBLE:
        return struct.pack(f"<{len(values)}d", *values)
    texts = [str(value).encode() for value in values]
    return b"".join(struct.pack("<I", len(text)) + text for text in texts)


def _bits(values: Sequence[bool]) -> bytes:
    """Return truth values as bits, the first one the lowest of its byte."""
    number = sum(1 << i for i, value in enumerate(values) if value)
    return number.to_bytes((len(values) + 7) // 8, "little")


# Structures of the format; the numbers of the fields are those of its Thrift definition.


def _page_header(count: int, size: int) -> bytes:
    page = _struct((1, _i32(count)), (2, _i32(_PLAIN)), (3, _i32(_RLE)), (4, _i32(_RLE)))
    return _struct((1, _i32(_DATA_PAGE)), (2, _i32(size)), (3, _i32(size)), (5, page))[1]


def _chunk(column: Column, offset: int, size: int) -> _Field:
    metadata = _struct(
        (1, _i32(column.kind)),
        (2, _list([_i32(_PLAIN), _i32(_RLE)])),
        (3, _list([_text(column.name)])),
        (4, _i32(_UNCOMPRESSED)),
        (5, _i64(len(column.values))),
        (6, _i64(size)),
        (7, _i64(size)),
        (9, _i64(offset)),
    )
    return _struct((2, _i64(offset)), (3, metadata))


def _footer(columns: Sequence[Column], chunks: Sequence[_Field], size: int) -> bytes:
    rows = len(columns[0].values)
    root = _struct((4, _text("table")), (5, _i32(len(columns))))
    group = _struct((1, _list(chunks)), (2, _i64(size)), (3, _i64(rows)))
    return _struct(
        (1, _i32(1)),
        (2, _list([root, *map(_schema, columns)])),
        (3, _i64(rows)),
        (4, _list([group])),
        (6, _text(_CREATED_BY)),
    )[1]


def _schema(column: Column) -> _Field:
    fields = [(1, _i32(column.kind)), (3, _i32(_OPTIONAL)), (4, _text(column.name))]
    if column.kind == _BYTE_ARRAY:
        fields += [(6, _i32(_UTF8)), (10, _struct((1, _struct())))]
    return _struct(*fields)


# Thrift's compact protocol: a value is its type and its bytes.

_Field = tuple[int, bytes]


def _varint(number: int) -> bytes:
    """Return seven bits a byte, the lowest first, the highest bit set but in the last one."""
    content = bytearray()
    while number > 0x7F:
        content.append(number & 0x7F | 0x80)
        number >>= 7
    content.append(number)
    return bytes(content)


def _zigzag(number: int) -> bytes:
    return _varint(number << 1 if number >= 0 else (-number << 1) - 1)


def _i32(number: int) -> _Field:
    return 5, _zigzag(number)


def _i64(number: int) -> _Field:
    return 6, _zigzag(number)


def _text(text: str) -> _Field:
    content = text.encode()
    return 8, _varint(len(content)) + content


def _list(items: Sequence[_Field]) -> _Field:
    kind = items[0][0]
    size = bytes([len(items) << 4 | kind]) if len(items) < 15 else bytes([0xF0 | kind])
    if len(items) >= 15:
        size += _varint(len(items))
    return 9, size + b"".join(content for _, content in items)


def _struct(*fields: tuple[int, _Field]) -> _Field:
    """Return a structure; fields rise, by 15 at most from one to the next."""
    content, last = bytearray(), 0
    for number, (kind, value) in fields:
        content += bytes([(number - last) << 4 | kind]) + value
        last = number
    return 12, bytes(content) + b"\0"
