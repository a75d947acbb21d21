"""What a bench is: something that carries out runs, and tells what happens as it does."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from imotor_ros.campaign.plan import RunPlan
from imotor_ros.core.correction import Excitation, ExcitationRequest
from imotor_ros.core.indicators import Performance
from imotor_ros.core.trial import Recording, Trial


@dataclass(frozen=True)
class PhaseEntered:
    """A run has come to a new phase, e.g. "nodes start"."""

    phase: str


@dataclass(frozen=True)
class DriveAdvanced:
    """The plant has consumed so many of all the samples of the run."""

    consumed: int
    length: int


@dataclass(frozen=True)
class PerformanceReported:
    """The evaluator has given its indicators, provisional or final."""

    performance: Performance


@dataclass(frozen=True)
class ExcitationAdvanced:
    """
    The search for the voltage has come to a new trial.

    Attributes
    ----------
    stage : str
        What it is for, e.g. "cycle 1".
    amplitude_error, phase_error : float
        Largest errors found so far (relative; rad), NaN before the first.

    """

    stage: str
    amplitude_error: float
    phase_error: float


RunEvent = PhaseEntered | ExcitationAdvanced | DriveAdvanced | PerformanceReported


class Bench(Protocol):
    """Carries out runs; a context manager, so that nothing is left behind."""

    name: str

    def __enter__(self) -> Self:
        """Make ready."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop everything."""

    def excite(
        self, plan: RunPlan, request: ExcitationRequest
    ) -> Generator[RunEvent, None, Excitation]:
        """
        Find the voltage for a motion, yield what happens, and return it.

        Nothing is recorded; `plan` says which stand is used.

        Raises
        ------
        BadInputError
            If the motion needs more than is allowed, with both values.
        RunError
            If no voltage is found.

        """

    def run(self, plan: RunPlan) -> Iterator[RunEvent]:
        """
        Carry out one run and yield what happens; the last event is the final performance.

        The bag is closed and readable when the iteration ends, however it ends.

        Raises
        ------
        RunError
            If the run does not reach its end.

        """


@runtime_checkable
class TrialPlayer(Protocol):
    """A bench that plays trials without recording them, for searches that need no bag."""

    def play(self, trial: Trial, plan: RunPlan) -> Recording:
        """Play a trial on the stand of a run, and return the measured rod velocity."""
