"""Points and their plans: parameters, run ids and drive programs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.plan import VIRTUAL_EPOCH, plan_run, run_id_of
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.predictions import predict_point
from imotor_ros.core import model, taylor
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.parameters import Parameters, all_leaves
from imotor_ros.errors import BadInputError, SolverError

POINT = NamedPoint("n2", PointParameters())


def parameter_classes(root: type[Parameters] = Parameters) -> list[type[Parameters]]:
    """Return every parameter class of the package that has been imported."""
    found = []
    for one in root.__subclasses__():
        found += [one, *parameter_classes(one)]
    return [one for one in found if one.__module__.startswith("imotor_ros.")]


def test_every_parameter_of_a_point_says_what_it_is_and_accepts_its_default() -> None:
    assert len(parameter_classes()) > 15
    for one in parameter_classes():
        if dataclasses.is_dataclass(one):
            assert one.from_mapping(one().to_mapping()) == one(), one
    for name, _, info in all_leaves(PointParameters):
        assert info.meaning, name
        assert "\n" not in info.meaning, name


# ---- run ids -------------------------------------------------------------------------------


def test_run_id_is_stable() -> None:
    """Equal parameters, equal id, whatever the order of keys and however they were given."""
    mapping = POINT.parameters.to_mapping()
    backwards = dict(reversed(mapping.items()))
    again = PointParameters.from_mapping(json.loads(json.dumps(backwards)))
    assert run_id_of(NamedPoint("n2", again)) == run_id_of(POINT)
    with_integers = PointParameters.from_leaves({"drive.offset": 50, "seed": 1.0})
    assert run_id_of(NamedPoint("n2", with_integers)) == run_id_of(POINT)


def test_run_id_tells_points_apart() -> None:
    name, _, digest = run_id_of(POINT).rpartition("-")
    assert (name, len(digest)) == ("n2", 8)
    others = [
        NamedPoint("n3", POINT.parameters),
        NamedPoint("n2", POINT.parameters.replace(seed=2)),
        NamedPoint("n2", PointParameters.from_leaves({"stand.motor.slider.mass": 7e-3})),
        NamedPoint("n2", PointParameters.from_leaves({"stand.motor.friction.law": "coulomb"})),
    ]
    assert len({run_id_of(one) for one in (POINT, *others)}) == 5


# ---- plans -------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["parabolic_sawtooth", "classic_sawtooth", "sine"])
def test_planned_voltage_gives_the_wanted_motion(shape: str, tmp_path: Path) -> None:
    """The linear response of the motor turns the voltage of the steady drive into the motion."""
    parameters = PointParameters.from_leaves({"signal.shape": shape, "signal.harmonics": 3})
    plan = plan_run(NamedPoint("p", parameters), tmp_path)
    motion = parameters.signal.motion
    hold = next(s for s in plan.program.segments if s.label == "hold")
    motor = VirtualMotor(parameters.stand.motor, parameters.stand.sample_rate, 1)
    orders = np.arange(1, motion.harmonics + 1)
    response = motor.displacement_response(orders * motion.fundamental_frequency)
    voltage = np.array(hold.start_amplitudes) * np.exp(1j * np.array(hold.phases))
    wanted = np.array(motion.amplitudes) * np.exp(1j * np.array(motion.phases))
    assert np.allclose(response * voltage, wanted, rtol=1e-12, atol=0)
    assert hold.start_amplitudes == hold.end_amplitudes
    assert plan.program.motion_amplitudes == pytest.approx(motion.amplitudes)


def test_maximum_frequency_is_that_of_the_highest_harmonic() -> None:
    for harmonics in (1, 2, 5):
        parameters = PointParameters.from_leaves(
            {"signal.harmonics": harmonics, "signal.maximum_frequency": 10e3}
        )
        assert parameters.signal.motion.fundamental_frequency == pytest.approx(10e3 / harmonics)


def test_plan_says_all_that_is_needed_to_repeat_the_run(tmp_path: Path) -> None:
    plan = plan_run(POINT, tmp_path / "n2", {"host": "here"})
    assert plan.program.run_id == run_id_of(POINT)
    assert plan.program.epoch == VIRTUAL_EPOCH
    assert plan.bag_path == tmp_path / "n2" / "bag"
    info = json.loads(plan.run_info_json)
    assert PointParameters.from_mapping(info["parameters"]) == POINT.parameters
    assert "host" not in plan.run_info_json, "what differs from run to run is provenance"
    assert not (tmp_path / "n2").exists(), "planning writes nothing"


def test_signal_beyond_half_of_the_sample_rate_is_refused() -> None:
    leaves = {"signal.maximum_frequency": 100e3, "stand.sample_rate": 200e3}
    with pytest.raises(BadInputError, match=r"signal.maximum_frequency: .* got 100000.0, .*half"):
        PointParameters.from_leaves(leaves)
    assert PointParameters.from_leaves({**leaves, "signal.maximum_frequency": 99e3})


# ---- predictions ---------------------------------------------------------------------------------


def test_models_predict_the_free_motor_and_its_force_against_the_stop() -> None:
    parameters = PointParameters.from_leaves({"stand.motor.load.upper_stop": 3e-3})
    found = predict_point(parameters)
    motion, slider = parameters.signal.motion, parameters.stand.motor.slider
    for name, friction in (("model_1", "CoulombFriction"), ("model_2", "VelocityDependent")):
        law = next(m for m in _laws() if type(m).__name__.startswith(friction))
        free = model.predict(motion, slider, law)
        assert found[name]["mean_velocity"] == free.mean_velocity
        assert found[name]["ripple"] == free.ripple
        assert 0.0 < found[name]["force"] < 1.0, "less than the break-away force"
    json.dumps(found, allow_nan=False)


def _laws() -> list[object]:
    from imotor_ros.campaign.predictions import MODELS

    return list(MODELS.values())


def test_weak_motion_that_never_slides_predicts_no_velocity() -> None:
    parameters = PointParameters.from_leaves(
        {"signal.stroke": 1e-6, "signal.maximum_frequency": 100.0}
    )
    found = predict_point(parameters)["model_1"]
    assert found["mean_velocity"] == 0.0
    assert found["ripple"] is None
    assert found["reasons"]["durability"] == "the slider never slides"
    json.dumps(found, allow_nan=False)


def test_solver_that_cannot_go_on_leaves_reasons(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that was measured is not lost because a model fails."""

    def fail(*_: object, **__: object) -> None:
        raise SolverError("does not converge")

    monkeypatch.setattr(taylor, "simulate", fail)
    found = predict_point(PointParameters.from_leaves({"stand.motor.load.upper_stop": 3e-3}))
    assert found["model_1"]["mean_velocity"] > 0.0, "the closed form needs no series"
    assert found["model_1"]["force"] is None
    assert found["model_1"]["reasons"]["force"] == "does not converge"
