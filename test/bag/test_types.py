from __future__ import annotations

import shutil

import numpy as np
import pytest

from imotor_ros.bag.types import BagTypes, find_definitions, installed_types
from imotor_ros.contracts import messages
from imotor_ros.errors import BadInputError, UnreadableFileError

BLOCK = "imotor_msgs/msg/SampleBlock"


def test_block_survives_serialisation_to_the_last_bit(stand_run):
    run = stand_run(blocks=2, size=777)
    block = run.block("rod/velocity", 1)
    data = run.types.serialize(messages.block_to_message(run.types, block))
    found = messages.block_from_message(run.types.deserialize(data, BLOCK))
    assert np.array_equal(found.samples, block.samples)
    for name in ("stream", "run_id", "time", "sequence", "first_index", "sample_rate", "unit"):
        assert getattr(found, name) == getattr(block, name)


@pytest.mark.parametrize("values", [[1, 2, 3], np.arange(6.0)[::2], np.arange(3, dtype="f4"), []])
def test_floats_takes_any_sequence_of_numbers(values):
    types = installed_types()
    found = types.floats(values)
    assert found.dtype == np.float64
    assert found.flags.c_contiguous
    assert np.array_equal(found, values)


def test_definitions_of_the_bag_make_the_same_bytes(stand_run):
    run = stand_run(blocks=1)
    types = run.types
    names = {message.topic for message in run.in_order()}
    kinds = {run.types.store.types[n].__msgtype__ for n in run.types.store.types if "imotor" in n}
    others = BagTypes.from_definitions({kind: types.definition(kind) for kind in kinds})
    assert names
    for message in run.latched():
        kind = (
            "imotor_msgs/msg/"
            + {
                "run/info": "RunInfo",
                "drive/program": "DriveProgram",
                "channels": "Channel",
            }[message.topic]
        )
        assert others.type_hash(kind) == types.type_hash(kind)
        assert others.serialize(others.deserialize(message.data, kind)) == message.data


def test_installed_definitions_come_before_those_of_the_checkout(tmp_path, monkeypatch):
    checkout = find_definitions()
    share = tmp_path / "share" / "imotor_msgs" / "msg"
    shutil.copytree(checkout, share)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'other'}:{tmp_path}")
    assert find_definitions() == share


def test_missing_definitions_are_told_with_the_places_searched(tmp_path, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setattr("imotor_ros.__file__", str(tmp_path / "site" / "imotor_ros" / "x.py"))
    with pytest.raises(UnreadableFileError, match=f"no message definitions.*{tmp_path}"):
        find_definitions()


def test_broken_definition_is_named(tmp_path):
    (tmp_path / "Odd.msg").write_text("float64 = = 3\n")
    with pytest.raises(UnreadableFileError, match="imotor_msgs/msg/Odd"):
        BagTypes.from_folder(tmp_path)


def test_unknown_type_and_bad_bytes_are_bad_input(stand_run):
    types = installed_types()
    with pytest.raises(BadInputError, match="no such message type"):
        types.message("imotor_msgs/msg/Nothing")
    data = next(stand_run().stream("load/force")).data
    for bad in (b"", b"\x00\x01", data[:40], b"\x07" + data[1:]):
        with pytest.raises(BadInputError, match="does not decode"):
            types.deserialize(bad, BLOCK)
