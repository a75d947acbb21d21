"""Tables as CSV and Parquet files."""

import csv
import struct
from pathlib import Path

import pytest

from imotor_ros.cli.parquet import Column, encode
from imotor_ros.cli.tables import check_table_path, write_table
from imotor_ros.errors import BadInputError, RecordingError

ROWS = [
    {"name": "n2", "velocity": 0.05, "harmonics": 2, "is_steady": True},
    {"name": "n3", "velocity": None, "harmonics": 3, "is_steady": False},
]

READ_BY_OTHERS = (
    "504152311500152415242c15041500150615060000020000000303020000006e32020000006e331500151c15"
    "1c2c150415001506150600000200000003019a9999999999a93f1500152c152c2c1504150015061506000002"
    "0000000303020000000000000003000000000000001500150e150e2c15041500150615060000020000000303"
    "011502195c48057461626c65150800150c250218046e616d6525004c1c000000150a2502180876656c6f6369"
    "7479001504250218096861726d6f6e6963730015002502180969735f737465616479001604191c194c26081c"
    "150c192500061918046e616d65150016041646164626080000264e1c150a1925000619180876656c6f636974"
    "7915001604163e163e264e0000268c011c1504192500061918096861726d6f6e69637315001604164e164e26"
    "8c01000026da011c15001925000619180969735f737465616479150016041630163026da0100001682021604"
    "00280a696d6f746f725f726f7300e900000050415231"
)
"""ROWS as a file that pyarrow 26.0.1 and duckdb 2.0.0 read as what they are."""


def test_parquet_file_is_the_one_that_other_readers_read() -> None:
    columns = [Column(name, [row[name] for row in ROWS]) for name in ROWS[0]]
    assert encode(columns).hex() == READ_BY_OTHERS


def test_parquet_file_holds_the_values_to_the_last_bit() -> None:
    numbers = [0.1 * i for i in range(1000)]
    content = encode([Column("velocity", numbers)])
    assert content[:4] == content[-4:] == b"PAR1"
    assert struct.pack("<1000d", *numbers) in content
    footer = struct.unpack("<I", content[-8:-4])[0]
    assert b"velocity" in content[-8 - footer : -8]


def test_parquet_tells_whole_numbers_from_numbers_and_nothing_from_zero() -> None:
    whole, mixed = Column("a", [1, None]), Column("a", [1, 0.5])
    assert (whole.kind, mixed.kind, Column("a", [None]).kind) == (2, 5, 5)
    assert struct.pack("<q", 0) not in encode([whole])


def test_csv_holds_the_values_to_the_last_bit(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write_table([*ROWS, {"velocity": 1.0 / 3.0, "force": 0.1}], path)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["name", "velocity", "harmonics", "is_steady", "force"]
    assert float(rows[2]["velocity"]) == 1.0 / 3.0
    assert rows[1]["velocity"] == rows[0]["force"] == ""


def test_table_replaces_an_older_one_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    write_table(ROWS[:1], path)
    write_table(ROWS, path)
    assert path.read_bytes().hex() == READ_BY_OTHERS
    assert list(tmp_path.iterdir()) == [path]


def test_bad_paths_are_refused_before_any_work(tmp_path: Path) -> None:
    for path, text in (
        (tmp_path / "table.xls", "expected .csv or .parquet"),
        (tmp_path / "missing" / "table.csv", "no such folder"),
    ):
        with pytest.raises(BadInputError, match=text):
            check_table_path(path)
    with pytest.raises(RecordingError, match="cannot be written"):
        write_table(ROWS, tmp_path / "missing" / "table.csv")
