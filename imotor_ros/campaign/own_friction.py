"""
The friction of a campaign's motor, identified by a run of its own on the same bench.

The models that a campaign compares with its measurement then use what can be measured of the
friction, with the errors of the instruments, and not what the virtual motor was given.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from imotor_ros.bag.identify import identify_bag
from imotor_ros.campaign.campaign import Campaign, NamedPoint
from imotor_ros.campaign.point import PointParameters
from imotor_ros.core.identification.results import Identification
from imotor_ros.core.slider import LoadParameters
from imotor_ros.errors import RunError

FOLDER = "identification"

_LAWS = {"model_1": "coulomb", "model_2": "velocity"}
"""The fits that are the models of the paper: equations (9) and (8)."""


def identification_points(campaign: Campaign) -> list[tuple[NamedPoint, tuple[str, ...]]]:
    """
    Return the identification runs that a campaign needs, and the points each one is for.

    One run for each stand, whatever the load of its motor; it has the seed, and so the
    instruments, of the first of its points.

    Parameters
    ----------
    campaign : Campaign
        The campaign; without the key ``identification`` it needs none.

    """
    drive = campaign.identification
    if drive is None:
        return []
    groups: dict[str, list[NamedPoint]] = {}
    for point in campaign.points:
        unloaded = _unloaded(point.parameters)
        groups.setdefault(json.dumps(unloaded.stand.to_mapping()), []).append(point)
    runs = []
    for number, points in enumerate(groups.values(), 1):
        name = FOLDER if number == 1 else f"{FOLDER}_{number}"
        parameters = _unloaded(points[0].parameters).replace(drive=drive, report_interval=0.0)
        run = NamedPoint(name, parameters, points[0].driver)
        runs.append((run, tuple(point.name for point in points)))
    return runs


def _unloaded(parameters: PointParameters) -> PointParameters:
    """Return the point without load; the stops stand where they are out of the way."""
    motor = parameters.stand.motor.replace(load=LoadParameters())
    return parameters.replace(stand=parameters.stand.replace(motor=motor))


def identify_models(bag: Path) -> dict[str, Any]:
    """
    Return the laws of both models from the bag of an identification run, as plain JSON.

    Parameters
    ----------
    bag : Path
        The bag.

    Returns
    -------
    dict
        "models" (the friction group of a motor file by model), "estimates" (by model and
        parameter: value, 95 % interval of noise and misfit, standard uncertainty by calibration),
        "curve" (force over mean relative speed of each step), and what they rest on.

    Raises
    ------
    RunError
        If the run does not show the friction.

    """
    found = identify_bag(bag)
    missing = [law for law in _LAWS.values() if law not in found.fits]
    if found.reason or missing:
        raise RunError(f"no friction law: {found.reason or ', '.join(missing)}")
    steps = [one for one in found.steps if one.measurement is not None]
    return {
        "frequency": found.frequency,
        "mass": found.mass,
        "steps": len(found.steps),
        "fitted": sum(one.is_fitted for one in found.steps),
        "chosen": found.chosen,
        "models": {model: _mapping(found, law) for model, law in _LAWS.items()},
        "estimates": {model: _estimates(found, law) for model, law in _LAWS.items()},
        "warnings": list(found.warnings),
        "curve": {
            "speed": [one.measurement.mean_relative_speed for one in steps if one.measurement],
            "force": _forces(found),
            "is_fitted": [one.is_fitted for one in steps],
        },
    }


def _forces(found: Identification) -> list[float]:
    measured = [one.measurement for one in found.steps if one.measurement is not None]
    return [found.mass * one.mean_acceleration for one in measured]


def _mapping(found: Identification, law: str) -> dict[str, Any]:
    """Return a law as in a motor file; break-away as the paper assumes, at zero speed."""
    estimates = found.fits[law].estimates
    values = {name: one.value for name, one in estimates.items() if name != "zero_speed_force"}
    return {"law": law, **values, "break_away_force": 0.0}


def _estimates(found: Identification, law: str) -> dict[str, Any]:
    calibration = found.calibration.uncertainties if found.calibration else {}
    return {
        name: {**one.to_mapping(), "calibration": calibration.get(name)}
        for name, one in found.fits[law].estimates.items()
    }
