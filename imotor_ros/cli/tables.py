"""Tables for other programs: CSV and Parquet files, SI units."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from imotor_ros.cli.parquet import Column, Value, encode
from imotor_ros.errors import BadInputError, RecordingError

TABLE_FORMATS = (".csv", ".parquet")
"""Endings that `write_table` knows."""


def check_table_path(path: Path) -> None:
    """
    Refuse a file whose ending stands for no format, or that cannot be written.

    To be called before long work whose result is to be kept there.

    Raises
    ------
    BadInputError
        If so.

    """
    if path.suffix not in TABLE_FORMATS:
        raise BadInputError(
            "has no ending of a table", where=str(path), bound=" or ".join(TABLE_FORMATS)
        )
    if path.is_dir():
        raise BadInputError("cannot be written: is a folder", where=str(path))
    if not path.absolute().parent.is_dir():
        raise BadInputError("cannot be written: there is no such folder", where=str(path))


def write_table(rows: Sequence[Mapping[str, Value]], path: Path) -> None:
    """
    Write a table; what was in its place is replaced at once or not at all.

    Parameters
    ----------
    rows : sequence of mapping
        Value by name of the column: text, truth value, number, or None where there is none,
        which is an empty field in CSV and a null in Parquet. The columns are those of all rows,
        in the order in which they come first.
    path : Path
        File; its ending is the format, one of `TABLE_FORMATS`.

    Raises
    ------
    BadInputError
        If the ending is unknown.
    RecordingError
        If the file cannot be written.

    """
    if path.suffix not in TABLE_FORMATS:
        check_table_path(path)
    names = list(dict.fromkeys(name for row in rows for name in row))
    content = _csv(rows, names) if path.suffix == ".csv" else _parquet(rows, names)
    temporary = path.with_name(f".{path.name}.new")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        cause = error.strerror or str(error)
        raise RecordingError(f"{path}: cannot be written: {cause}") from error


def _csv(rows: Sequence[Mapping[str, Value]], names: Sequence[str]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _parquet(rows: Sequence[Mapping[str, Value]], names: Sequence[str]) -> bytes:
    return encode([Column(name, [row.get(name) for row in rows]) for name in names])
