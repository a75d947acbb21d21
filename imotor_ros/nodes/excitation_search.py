"""The orchestrator's side of the action drive/correct: a search for a voltage that is under way."""

from __future__ import annotations

from typing import Any

from rclpy.task import Future

from imotor_ros.campaign.bench import ExcitationAdvanced
from imotor_ros.contracts.excitation_messages import excitation_from_message, refusal_from_message
from imotor_ros.contracts.outcomes import CANCELLED, COMPLETED
from imotor_ros.core.correction import Excitation, ExcitationRequest
from imotor_ros.errors import ExcitationError, StoppedError


class ExcitationSearch:
    """
    A search for a voltage that the signal generator carries out.

    Parameters
    ----------
    request : ExcitationRequest
        What it was asked.

    Attributes
    ----------
    steps : list of ExcitationAdvanced
        The trials that have begun.
    is_done : bool
        Whether it has ended.

    """

    def __init__(self, request: ExcitationRequest) -> None:
        self._request = request
        self.steps: list[ExcitationAdvanced] = []
        self.is_done = False
        self._outcome = "refused"
        self._result: Any = None
        self._handle: Any = None

    def follow(self, handle: Any) -> None:
        """Take the goal's handle, and ask for its result."""
        self._handle = handle
        if not handle.accepted:
            self.is_done = True
            return
        handle.get_result_async().add_done_callback(self._on_result)

    def on_feedback(self, message: Any) -> None:
        """Take note of a trial that begins."""
        news = message.feedback
        self.steps.append(ExcitationAdvanced(news.stage, news.amplitude_error, news.phase_error))

    def _on_result(self, future: Future) -> None:
        self._result = future.result().result
        self._outcome = self._result.outcome
        self.is_done = True

    def has_passed(self, steps: int) -> bool:
        """Whether more trials than these have begun, or the search has ended."""
        return self.is_done or len(self.steps) > steps

    def cancel(self) -> None:
        """Ask for the voltage to go to zero and the search to end."""
        if self._handle is not None and not self.is_done:
            self._handle.cancel_goal_async()

    def excitation(self) -> Excitation:
        """
        Return what was found.

        Raises
        ------
        DriveLimitError
            If a limit is in the way.
        StoppedError
            If an operator stopped the drive.
        ExcitationError
            If no voltage was found for another reason.

        """
        if self._result is not None and self._result.refusals:
            raise refusal_from_message(self._result.refusals[0])
        if self._outcome == CANCELLED:
            raise StoppedError("the search for the voltage")
        if self._outcome != COMPLETED:
            raise ExcitationError(self._outcome or "the signal generator gave no result")
        return excitation_from_message(self._request, self._result)
