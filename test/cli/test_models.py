"""The verbs that only compute: signal and simulate."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from imotor_ros.core.friction import CoulombFriction, VelocityDependentFriction
from imotor_ros.core.model import predict
from imotor_ros.core.signals import classic_sawtooth, parabolic_sawtooth
from imotor_ros.core.slider import LoadParameters, SliderParameters

Imotor = Callable[..., Any]


# ---- signal ----------------------------------------------------------------------------------


def test_signal_gives_row_1_of_table_1_in_every_printed_digit(imotor: Imotor) -> None:
    """Table 1 of the paper, desired displacement: amplitudes in um, phases in degrees."""
    answer = imotor("signal", "--harmonics", 4, "--json")
    assert answer.code == 0
    content = answer.json
    amplitudes = [f"{1e6 * amplitude:.3f}" for amplitude in content["amplitudes"]]
    phases = [f"{math.degrees(phase):.2f}" for phase in content["phases"]]
    assert amplitudes == ["6.230", "2.432", "1.073", "0.372"]
    assert phases == ["0.00", "-153.73", "46.91", "-113.92"]
    table = imotor("signal", "--harmonics", 4).out.splitlines()
    assert table[2].split() == ["1", "6.230", "0.00"]
    assert table[5].split() == ["4", "0.372", "-113.92"]


def test_signal_scales_with_the_stroke_and_has_another_shape(imotor: Imotor) -> None:
    answer = imotor(
        "signal", "--harmonics", 3, "--stroke", 2e-6, "--shape", "classic_sawtooth", "--json"
    )
    motion = classic_sawtooth(3, 2e-6, fundamental_frequency=1.0)
    assert answer.json["amplitudes"] == list(motion.amplitudes)
    assert answer.json["phases"] == list(motion.relative_phases)
    assert answer.json["stroke"] == 2e-6


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--harmonics", 0], "--harmonics: is out of bounds, got 0, expected >= 1"),
        (["--harmonics", -3], "--harmonics: is out of bounds, got -3"),
        (["--harmonics", 10**6], "harmonics: is out of bounds, got 1000000"),
        (["--harmonics", 2, "--stroke", 0], "--stroke: is out of bounds, got 0.0, expected > 0 m"),
        (["--harmonics", 2, "--stroke", "nan"], "--stroke: is out of bounds, got nan"),
        (["--harmonics", 2, "--stroke", "inf"], "--stroke: is out of bounds, got inf"),
    ],
)
def test_signal_refuses_what_it_cannot_do(imotor: Imotor, options: list[Any], text: str) -> None:
    for extra in ([], ["--json"]):
        answer = imotor("signal", *options, *extra)
        assert answer.code == 2
        assert text in answer.error


# ---- simulate ----------------------------------------------------------------------------------

BASE = ("--harmonics", 3, "--max-frequency", 9250.0, "--periods", 400)
LAWS = {"coulomb": CoulombFriction(), "velocity": VelocityDependentFriction()}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("options", "load", "rate"),
    [
        ([], {}, None),
        (["--sample-rate", 1e6], {}, 1e6),
        (["--load-force", 0.1], {"constant_force": 0.1}, None),
        (["--load-stiffness", 2e4], {"spring_stiffness": 2e4}, None),
    ],
)
def test_simulate_gives_what_the_model_predicts(
    imotor: Imotor, law: str, options: list[Any], load: dict[str, float], rate: float | None
) -> None:
    """To the last bit; the names are those that scripts rely on."""
    answer = imotor("simulate", *BASE, "--friction", law, *options, "--json")
    assert answer.code == 0
    expected = predict(
        parabolic_sawtooth(3, maximum_frequency=9250.0),
        SliderParameters(),
        LAWS[law],
        LoadParameters.free().replace(**load),
        periods=400,
        sample_rate=rate,
    )
    content = answer.json
    for name in ("mean_velocity", "ripple", "start_up_time", "durability", "force"):
        assert content[name] == getattr(expected, name), name
    assert content["solver"] == expected.solver
    assert (content["force"] is None) == (not load)


def test_simulate_prints_scaled_units_and_reasons(imotor: Imotor) -> None:
    answer = imotor("simulate", *BASE, "--friction", "coulomb")
    lines = answer.out.splitlines()
    expected = predict(
        parabolic_sawtooth(3, maximum_frequency=9250.0),
        SliderParameters(),
        CoulombFriction(),
        LoadParameters.free(),
        periods=400,
    )
    velocity = next(line for line in lines if line.startswith("steady-state velocity"))
    assert velocity.split()[-2:] == [f"{1e3 * expected.mean_velocity:.4g}", "mm/s"]
    assert "force: there is no load" in lines
    assert lines[-1] == "400 periods, solver closed_form"


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--harmonics", 0], "--harmonics: is out of bounds, got 0"),
        (["--max-frequency", "nan"], "--max-frequency: is out of bounds, got nan, expected > 0"),
        (["--max-frequency", -1], "--max-frequency: is out of bounds, got -1.0"),
        (["--stroke", 0], "--stroke: is out of bounds, got 0.0"),
        (["--periods", 3], "--periods: is out of bounds, got 3, expected 4 to 10000000"),
        (["--load-stiffness", -1], "--load-stiffness: is out of bounds, got -1.0"),
        (["--load-force", "inf"], "--load-force: is out of bounds, got inf"),
        (["--sample-rate", 100], "--sample-rate: is too low for the highest harmonic, got 100.0"),
        (["--sample-rate", "nan"], "--sample-rate: is out of bounds, got nan"),
        (["--sample-rate", 0], "--sample-rate: is out of bounds, got 0.0"),
    ],
)
def test_simulate_refuses_what_it_cannot_do(imotor: Imotor, options: list[Any], text: str) -> None:
    answer = imotor("simulate", *BASE, "--friction", "velocity", *options, "--json")
    assert answer.code == 2
    assert text in answer.error
