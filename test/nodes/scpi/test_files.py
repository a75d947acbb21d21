"""Dialects, benches and laboratories of the project, and what is wrong with others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from imotor_ros.errors import BadInputError, UnknownKeyError, UnreadableFileError
from imotor_ros.nodes.scpi.dialect import (
    GeneratorDialect,
    OscilloscopeDialect,
    dialect_from_mapping,
    load_dialect,
)
from imotor_ros.nodes.scpi.settings import BenchSettings, describe
from imotor_ros.nodes.virtual_instruments.server import GENERATORS, OSCILLOSCOPES, main

SCPI = Path(__file__).parents[3] / "params" / "scpi"


def dialect(name: str) -> dict[str, Any]:
    """Return the content of a dialect file."""
    mapping: dict[str, Any] = yaml.safe_load((SCPI / "dialects" / f"{name}.yaml").read_text())
    return mapping


def bench(name: str) -> dict[str, Any]:
    """Return the parameters of a bench file."""
    text = (SCPI / "benches" / f"{name}.yaml").read_text()
    mapping: dict[str, Any] = yaml.safe_load(text)["/**"]["ros__parameters"]
    return mapping


@pytest.mark.parametrize("path", sorted((SCPI / "dialects").glob("*.yaml")), ids=lambda p: p.stem)
def test_dialects_of_the_project_load_and_have_virtual_instruments(path: Path) -> None:
    made = dialect_from_mapping(yaml.safe_load(path.read_text()), str(path))
    known = GENERATORS if isinstance(made, GeneratorDialect) else OSCILLOSCOPES
    assert path.stem in known


@pytest.mark.parametrize("path", sorted((SCPI / "benches").glob("*.yaml")), ids=lambda p: p.stem)
def test_benches_of_the_project_load(path: Path) -> None:
    settings = BenchSettings.from_mapping(bench(path.stem))
    load_dialect(settings.generator.dialect, GeneratorDialect)
    for one in settings.oscilloscopes.values():
        load_dialect(one.dialect, OscilloscopeDialect)
    laboratory = SCPI / "laboratories" / f"{path.stem.removeprefix('virtual_')}.yaml"
    described = yaml.safe_load(laboratory.read_text())
    assert described["amplifier_gain"] == settings.generator.amplifier_gain
    assert described["generator"]["memory"] == settings.generator.memory
    for name, channel in settings.channels.items():
        scope = described["oscilloscopes"][channel.oscilloscope - 1]
        wire = scope["wires"][int(channel.input)]
        assert wire == name.rpartition("/")[2] or name in ("rod/velocity", "slider/velocity",
                                                           "load/force")  # fmt: skip
        assert described["volts_per_unit"][wire] * channel.factor == pytest.approx(1.0)
        assert scope["bits"] == settings.oscilloscopes[channel.oscilloscope].bits


def test_description_of_a_channel_follows_from_transducer_and_oscilloscope() -> None:
    settings = BenchSettings.from_mapping(bench("virtual_four_inputs_twice"))
    channel = describe("drive/voltage_monitor", settings, 1.25e6, {1: "scope"})
    step = 2 * 6.0 * 20.0 / 2**8
    assert channel.resolution == pytest.approx(step)
    assert channel.range == pytest.approx(120.0)
    assert channel.gain_uncertainty == pytest.approx((0.005**2 + 0.01**2) ** 0.5)
    assert channel.offset_uncertainty == pytest.approx((0.02**2 + step**2 / 12) ** 0.5)
    noise = channel.noise_density**2 - 1e-5**2
    assert noise * 0.625e6 == pytest.approx(2 * step**2 / 12)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"kind": "printer"}, "kind: is no dialect, got 'printer'"),
        ({"colour": "red"}, "colour: is not a key"),
        ({"trigger": "SOUR{outptu}:TRIG"}, "trigger: names what is not known, got 'outptu'"),
        ({"trigger": 3}, "trigger: is no str, got 3"),
        ({"enable": "OUTP ON"}, "enable: is no list of texts"),
        ({"no_error": "("}, "no_error: is no regular expression"),
        ({"words": {"type": "int24"}}, "words.type: is not a choice, got 'int24'"),
        ({"words": {"type": "int16", "full_scale": 40000}}, "words: does not fit the type"),
    ],
)
def test_wrong_dialect_is_refused(change: dict[str, Any], text: str) -> None:
    with pytest.raises(BadInputError) as caught:
        dialect_from_mapping({**dialect("keysight_33500"), **change}, "file")
    assert text in str(caught.value)


def test_dialect_without_a_key_or_a_preamble_entry_is_refused() -> None:
    mapping = dialect("tektronix_mso5")
    with pytest.raises(BadInputError, match="data_query: is missing"):
        dialect_from_mapping({k: v for k, v in mapping.items() if k != "data_query"}, "file")
    with pytest.raises(BadInputError, match=r"does not tell, got .*x_origin"):
        dialect_from_mapping({**mapping, "preamble": ["points", "y_origin"]}, "file")


def test_dialect_that_is_not_there_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFileError, match=r"one of .*keysight_33500.*tektronix_mso5"):
        load_dialect("acme", GeneratorDialect)
    with pytest.raises(BadInputError, match="another kind, got 'oscilloscope'"):
        load_dialect("tektronix_mso5", GeneratorDialect)
    with pytest.raises(UnreadableFileError, match="cannot be read"):
        load_dialect(str(tmp_path / "none.yaml"), GeneratorDialect)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"current": {"input": "1"}}, "current: input: is no input of its own, got '1'"),
        ({"current": {"input": "9", "oscilloscope": 2}}, "oscilloscope: has no address, got 2"),
        ({"current": {"input": "9", "factor": 0.0}}, "factor: is zero"),
    ],
)
def test_wrong_wiring_is_refused(change: dict[str, Any], text: str) -> None:
    with pytest.raises(BadInputError) as caught:
        BenchSettings.from_mapping({**bench("virtual_eight_inputs"), **change})
    assert text in str(caught.value)


def test_unknown_parameter_of_a_bench_is_refused() -> None:
    with pytest.raises(UnknownKeyError):
        BenchSettings.from_mapping({**bench("virtual_eight_inputs"), "colour": "red"})


def test_laboratory_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "lab.yaml"
    path.write_text("amplifier_gain: 20.0\n")
    assert main([str(path), "--any-port"]) == 2
    assert "does not describe it" in capsys.readouterr().err
