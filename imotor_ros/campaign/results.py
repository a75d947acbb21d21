"""The results of a campaign: what came of each run, and the file that holds all of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from imotor_ros.campaign.campaign import Campaign
from imotor_ros.campaign.conclusions import MeasuredPoint, draw_conclusions
from imotor_ros.campaign.plan import run_id_of
from imotor_ros.core.friction import FRICTION_LAWS, FrictionLaw
from imotor_ros.core.indicators import Performance
from imotor_ros.core.parameters import Parameters
from imotor_ros.errors import BadInputError, RecordingError, UnreadableFileError

RESULTS_NAME = "results.json"

DONE = "done"
FAILED = "failed"


@dataclass(frozen=True)
class PointResult:
    """
    What came of one point.

    Attributes
    ----------
    name, run_id : str
        Name of the point and id of its run.
    status : str
        "done" or "failed".
    error : str
        Why it failed; empty otherwise.
    performance : Performance or None
        The final indicators; None where it failed.
    predictions : mapping
        What each model predicts, by model and indicator; a value is a number or None. Empty as
        long as the friction law of the models is not known.
    bag : str
        Path of the bag, relative to the results.
    seconds : float
        How long it took.

    """

    name: str
    run_id: str
    status: str
    error: str
    performance: Performance | None
    predictions: Mapping[str, Mapping[str, Any]]
    bag: str
    seconds: float

    def to_mapping(self) -> dict[str, Any]:
        """Return the result as plain JSON; what differs from run to run is left out."""
        return {
            "name": self.name,
            "run_id": self.run_id,
            "status": self.status,
            "error": self.error,
            "bag": self.bag,
            "performance": None if self.performance is None else self.performance.to_mapping(),
            "predictions": {model: dict(values) for model, values in self.predictions.items()},
        }

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> PointResult:
        """Return the result that `to_mapping` wrote."""
        performance = mapping["performance"]
        return cls(
            name=mapping["name"],
            run_id=mapping["run_id"],
            status=mapping["status"],
            error=mapping["error"],
            performance=None if performance is None else Performance.from_mapping(performance),
            predictions=mapping["predictions"],
            bag=mapping["bag"],
            seconds=0.0,
        )


@dataclass(frozen=True)
class FrictionResult:
    """
    What came of a run that friction was identified from.

    Attributes
    ----------
    name, run_id, status, error, bag, seconds
        As of `PointResult`.
    points : tuple of str
        Names of the points whose motor it is about.
    identified : mapping
        The laws of both models, their estimates and the measured curve; empty where it failed.

    """

    name: str
    run_id: str
    status: str
    error: str
    bag: str
    seconds: float
    points: tuple[str, ...] = ()
    identified: Mapping[str, Any] = field(default_factory=dict)

    @property
    def laws(self) -> dict[str, FrictionLaw]:
        """The friction law of each model; none where it failed."""
        return {
            model: law_from_mapping(mapping)
            for model, mapping in self.identified.get("models", {}).items()
        }

    def to_mapping(self) -> dict[str, Any]:
        """Return the result as plain JSON; what differs from run to run is left out."""
        return {
            "name": self.name,
            "run_id": self.run_id,
            "status": self.status,
            "error": self.error,
            "bag": self.bag,
            "points": list(self.points),
            **self.identified,
        }

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> FrictionResult:
        """Return the result that `to_mapping` wrote."""
        known = ("name", "run_id", "status", "error", "bag", "points")
        name, run_id, status, error, bag, points = (mapping[key] for key in known)
        identified = {key: value for key, value in mapping.items() if key not in known}
        return cls(name, run_id, status, error, bag, 0.0, tuple(points), identified)


RunResult = PointResult | FrictionResult


def law_mapping(law: FrictionLaw) -> dict[str, Any]:
    """Return a friction law as the friction group of a motor file has it."""
    assert isinstance(law, Parameters)
    name = next(key for key, kind in FRICTION_LAWS.items() if isinstance(law, kind))
    return {"law": name, **law.to_mapping()}


def law_from_mapping(mapping: Mapping[str, Any]) -> FrictionLaw:
    """Return the friction law that `law_mapping` wrote."""
    values = {key: value for key, value in mapping.items() if key != "law"}
    law = FRICTION_LAWS[mapping["law"]].from_mapping(values)
    assert isinstance(law, FrictionLaw)
    return law


@dataclass
class Results:
    """
    The results so far.

    Attributes
    ----------
    campaign : Campaign
        What is measured.
    bench : str
        Name of the bench.
    laws : mapping
        Friction law by model, for points whose friction is not identified.
    friction : dict
        Identification runs by run id.
    points : dict
        Points by run id.

    """

    campaign: Campaign
    bench: str
    laws: Mapping[str, FrictionLaw]
    friction: dict[str, FrictionResult] = field(default_factory=dict)
    points: dict[str, PointResult] = field(default_factory=dict)

    def laws_for(self, name: str) -> Mapping[str, FrictionLaw]:
        """Return the laws of a point's models, none as long as they are not known."""
        if self.campaign.identification is None:
            return self.laws
        return next((one.laws for one in self.friction.values() if name in one.points), {})

    def add_predictions(self, run_id: str, predictions: Mapping[str, Mapping[str, Any]]) -> None:
        """Add what the models predict to a point that is there already."""
        self.points[run_id] = replace(self.points[run_id], predictions=predictions)

    def in_order(self) -> tuple[PointResult, ...]:
        """Return the results of the points in the campaign's order."""
        order = [run_id_of(point) for point in self.campaign.points]
        return tuple(self.points[key] for key in order if key in self.points)

    def to_mapping(self) -> dict[str, Any]:
        """Return all of it as plain JSON, the same for the same runs."""
        friction = sorted(self.friction.values(), key=lambda one: one.name)
        return {
            "campaign": self.campaign.to_mapping(),
            "bench": self.bench,
            "models": self._models(),
            "identifications": [one.to_mapping() for one in friction],
            "points": [one.to_mapping() for one in self.in_order()],
            "conclusions": [one.to_mapping() for one in draw_conclusions(self._measured())],
        }

    def _models(self) -> dict[str, Any]:
        """Say whose friction the models have."""
        if self.campaign.identification is not None:
            return {"source": "identification", "laws": {}}
        laws = {model: law_mapping(law) for model, law in self.laws.items()}
        return {"source": "paper", "laws": laws}

    def _measured(self) -> list[MeasuredPoint]:
        parameters = {run_id_of(point): point.parameters for point in self.campaign.points}
        return [
            MeasuredPoint(one.name, parameters[one.run_id], one.performance, one.predictions)
            for one in self.in_order()
            if one.performance is not None
        ]

    def write(self, output: Path) -> None:
        """
        Write results.json: the old file or the new one is there at any time.

        Raises
        ------
        RecordingError
            If it cannot be written.

        """
        text = json.dumps(self.to_mapping(), indent=1, allow_nan=False)
        path, temporary = output / RESULTS_NAME, output / f".{RESULTS_NAME}.new"
        try:
            temporary.write_text(text + "\n", encoding="utf-8")
            temporary.replace(path)
        except OSError as error:
            cause = error.strerror or str(error)
            raise RecordingError(f"{path}: cannot be written: {cause}") from error

    def read(self, output: Path, friction_ids: Iterable[str]) -> None:
        """
        Take what is done from results.json; what failed, or has lost its bag, is left out.

        Parameters
        ----------
        output : Path
            Folder of the results; without a file there is nothing to take.
        friction_ids : iterable of str
            Run ids of the campaign's identification runs.

        Raises
        ------
        UnreadableFileError
            If the file does not parse.
        BadInputError
            If it holds results of another campaign or bench.

        """
        path = output / RESULTS_NAME
        if not path.exists():
            return
        points, friction = self._parsed(path)
        known = {run_id_of(point) for point in self.campaign.points}
        _refuse_foreign(path, [one.name for one in points if one.run_id not in known])
        wanted = set(friction_ids)

        def is_done(one: RunResult) -> bool:
            return one.status == DONE and (output / one.bag).exists()

        self.friction = {o.run_id: o for o in friction if o.run_id in wanted and is_done(o)}
        for one in filter(is_done, points):
            # what was predicted by laws that are to be identified again is not known
            is_predicted = bool(self.laws_for(one.name))
            kept = one if is_predicted else replace(one, predictions={})
            self.points[one.run_id] = kept

    def _parsed(self, path: Path) -> tuple[Sequence[PointResult], Sequence[FrictionResult]]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            points = [PointResult.from_mapping(one) for one in content["points"]]
            found = content.get("identifications", [])
            bench = content.get("bench", self.bench)
            friction = [FrictionResult.from_mapping(one) for one in found]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise UnreadableFileError(f"does not parse: {error}", where=str(path)) from error
        if bench != self.bench:
            raise BadInputError(
                "holds results of another bench", where=str(path), value=bench, bound=self.bench
            )
        return points, friction


def _refuse_foreign(path: Path, foreign: Sequence[str]) -> None:
    if foreign:
        raise BadInputError(
            "holds points of another campaign, or of other parameters",
            where=str(path),
            value=foreign[0],
            bound="an output folder of this campaign",
        )
