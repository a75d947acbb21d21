"""Progress of a campaign on a terminal; silence elsewhere."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from imotor_ros.campaign.bench import (
    DriveAdvanced,
    ExcitationAdvanced,
    PerformanceReported,
    PhaseEntered,
    RunEvent,
)
from imotor_ros.campaign.runner import (
    CampaignEvent,
    CampaignFinished,
    CampaignStarted,
    PointFinished,
    PointStarted,
    RunAdvanced,
)
from imotor_ros.cli.output import SCALES, format_indicator


class CampaignProgress:
    """
    Shows the events of a campaign on standard error.

    On a terminal a bar with point, phase, estimated end and the provisional velocity; elsewhere
    one line for each finished point.
    """

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task: TaskID | None = None
        self._count = 0
        self._done = 0
        self._titles: dict[int, str] = {}
        self._shares: dict[int, float] = {}

    def __enter__(self) -> Self:
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the bar as it is."""
        self._bar.stop()

    def show(self, event: CampaignEvent) -> None:
        """Show one event."""
        match event:
            case CampaignStarted():
                self._count, self._done = event.runs, event.done_before
                self._task = self._bar.add_task(
                    event.campaign.name, total=self._count, completed=self._done, note=""
                )
            case PointStarted():
                title = f"{event.plan.name} ({event.number + 1}/{self._count})"
                self._titles[event.number], self._shares[event.number] = title, 0.0
                self._describe(event.number, "start")
            case RunAdvanced():
                self._advance(event.number, event.event)
            case PointFinished():
                self._finish_point(event)
            case CampaignFinished():
                self._update("done")

    def _advance(self, number: int, event: RunEvent) -> None:
        match event:
            case PhaseEntered():
                self._describe(number, event.phase)
            case ExcitationAdvanced():
                self._describe(number, event.stage)
            case DriveAdvanced():
                if number in self._shares:
                    self._shares[number] = min(event.consumed / max(1, event.length), 0.99)
                self._update(None)
            case PerformanceReported():
                velocity = event.performance.indicator("mean_velocity")
                unit = SCALES["mean_velocity"].unit
                self._note(
                    f"v = {format_indicator(velocity)} {unit}" if velocity.is_available else ""
                )

    def _finish_point(self, event: PointFinished) -> None:
        self._done += 1
        self._shares.pop(event.number, None)
        self._update(None)
        result = event.result
        title = self._titles.get(event.number, event.plan.name)
        text = f"{title}: {result.status}, {result.seconds:.1f} s"
        if result.error:
            text += f": {result.error}"
        self._console.print(text, markup=False, highlight=False)

    def _describe(self, number: int, phase: str) -> None:
        others = len(self._shares) - (number in self._shares)
        beside = f" (and {others} beside)" if others else ""
        self._update(f"{self._titles.get(number, 'models')}: {phase}{beside}")

    def _update(self, description: str | None) -> None:
        if self._task is None:
            return
        self._bar.update(self._task, completed=self._done + sum(self._shares.values()))
        if description is not None:
            self._bar.update(self._task, description=description)

    def _note(self, text: str) -> None:
        if self._task is not None:
            self._bar.update(self._task, note=text)
