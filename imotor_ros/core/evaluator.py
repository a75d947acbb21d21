"""
Evaluation of a run, block by block: the same for the live node, in-process and from a bag.

However the streams are cut into blocks and interleaved, the result is the same to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    MEASURED_CHANNELS,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
)
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.evaluator_parameters import EvaluatorParameters
from imotor_ros.core.indicators import UNITS, Indicator, Performance, Window
from imotor_ros.core.measured_stream import MeasuredStream
from imotor_ros.core.periods import PeriodGrid
from imotor_ros.core.plausibility import find_doubts
from imotor_ros.core.run_analysis import RunAnalysis
from imotor_ros.core.run_view import RunView
from imotor_ros.errors import BadInputError

__all__ = ["EvaluatorParameters", "PeriodWaveforms", "RunEvaluator"]

_UNITS = {
    ROD_VELOCITY: "m/s",
    SLIDER_VELOCITY: "m/s",
    LOAD_FORCE: "N",
    VOLTAGE: "V",
    CURRENT: "A",
}


@dataclass(frozen=True)
class PeriodWaveforms:
    """
    Mean waveforms of the free run over one drive period, for pictures.

    Attributes
    ----------
    phase : ndarray, shape (points,)
        Phase of the drive (cycles).
    velocities : dict of str to ndarray, shape (points,)
        Mean waveform (m/s) of "rod/velocity" and "slider/velocity", as far as there are any.
    periods : int
        Number of periods averaged.
    reason : str
        Why there are none; empty if there are.

    """

    phase: NDArray[np.float64]
    velocities: dict[str, NDArray[np.float64]]
    periods: int
    reason: str = ""


@dataclass
class _Block:
    """A block that came before the description of its channel."""

    first_index: int
    samples: NDArray[np.float64]
    flags: int
    sample_rate: float | None
    stamp_error: int


@dataclass
class _Run:
    """What is known of the run under evaluation."""

    program: DriveProgram
    grid: PeriodGrid | None
    reason: str
    streams: dict[str, MeasuredStream] = field(default_factory=dict)
    waiting: dict[str, list[_Block]] = field(default_factory=dict)


class RunEvaluator:
    """
    Takes what is measured during a run and says what it amounts to.

    Parameters
    ----------
    parameters : EvaluatorParameters, optional
        How to evaluate.

    """

    def __init__(self, parameters: EvaluatorParameters | None = None) -> None:
        self.parameters = parameters or EvaluatorParameters()
        self._current: _Run | None = None

    @property
    def _run(self) -> _Run:
        if self._current is None:
            raise BadInputError("has not begun", where="run", bound="begin() first")
        return self._current

    def begin(self, program: DriveProgram) -> None:
        """Begin a run, and forget the one before, its channels included."""
        grid, reason = _grid_of(program)
        self._current = _Run(program, grid, reason)

    def change_program(self, program: DriveProgram) -> None:
        """
        Take note that the program was cut short.

        Raises
        ------
        BadInputError
            If it is not the program of this run, cut short.

        """
        run = self._run
        old = run.program
        is_same = (program.run_id, program.epoch, program.sample_rate) == (
            old.run_id,
            old.epoch,
            old.sample_rate,
        )
        grid, reason = _grid_of(program)
        if grid is not None and run.grid is not None:
            is_same &= grid.origin == run.grid.origin and grid.period == run.grid.period
            is_same &= grid.count <= run.grid.count
        if not is_same or program.length > old.length:
            raise BadInputError(
                "is not the program of this run, cut short", where="drive program",
                value=program.run_id, bound=f"{old.run_id} with at most {old.length} samples",
            )  # fmt: skip
        run.program, run.grid, run.reason = program, grid, reason
        for stream in run.streams.values():
            stream.change_program(program)

    def add_channel(self, description: ChannelDescription) -> None:
        """
        Take note of what a channel is; its samples may have come before.

        Channels that no indicator needs are counted.

        Raises
        ------
        BadInputError
            If its unit is not the SI unit, its numbers make no sense, or the channel has been
            described differently before.

        """
        run, name = self._run, description.name
        if name in run.streams:
            if run.streams[name].description != description:
                raise BadInputError("is described twice, differently", where=name)
            return
        _check(description)
        run.streams[name] = MeasuredStream(
            description,
            run.program,
            run.grid if name in MEASURED_CHANNELS else None,
            keeps_waveforms=name != LOAD_FORCE,
            keeps_start=run.grid.origin if run.grid and name == LOAD_FORCE else 0,
        )
        for block in run.waiting.pop(name, []):
            run.streams[name].add(
                block.first_index, block.samples, block.flags, block.sample_rate, block.stamp_error
            )

    def add_samples(
        self,
        name: str,
        first_index: int,
        samples: ArrayLike,
        flags: int = 0,
        sample_rate: float | None = None,
        stamp_error: int = 0,
    ) -> None:
        """
        Take a block of samples of one channel.

        Parameters
        ----------
        name : str
            The channel.
        first_index : int
            Number of samples of the run before this block. What is missing or comes twice is
            counted and makes the indicators that rest on the channel unavailable.
        samples : array_like, shape (n,)
            The samples (unit of the channel).
        flags : int
            Bitwise or of `SampleFlag`.
        sample_rate : float, optional
            Samples per second (Hz), if the block tells; it must be that of the program.
        stamp_error : int
            By how much (ns) the block's time is not that of its first sample.

        Raises
        ------
        BadInputError
            If the samples are not one-dimensional or the index is negative.

        """
        run = self._run
        if name in run.streams:
            run.streams[name].add(first_index, samples, flags, sample_rate, stamp_error)
            return
        kept = np.array(samples, dtype=np.float64)
        block = _Block(first_index, kept, flags, sample_rate, stamp_error)
        run.waiting.setdefault(name, []).append(block)

    @property
    def is_complete(self) -> bool:
        """True once every described channel has come to the end of the program."""
        run = self._run
        ends = [stream.end_index for stream in run.streams.values()]
        return bool(ends) and not run.waiting and min(ends) >= run.program.length

    def performance(self, until: int | None = None) -> Performance:
        """
        Return the indicators as of now, or as of an earlier sample.

        Parameters
        ----------
        until : int, optional
            Number of samples of the run to rest on; by default as many as every channel has.
            With it, the result is provisional, and the same whatever came later.

        """
        run = self._run
        end = self._end(until)
        indicators: tuple[Indicator, ...]
        windows: tuple[Window, ...] = ()
        warnings: list[str] = []
        if run.grid is None:
            indicators = tuple(Indicator(name, u, reason=run.reason) for name, u in UNITS.items())
        else:
            view = RunView(self.parameters, run.program, run.grid, run.streams, end)
            view.doubts = find_doubts(view)
            analysis = RunAnalysis(view)
            indicators = analysis.indicators()
            windows = analysis.windows()
            warnings = view.warnings
        streams = sorted(run.streams.items())
        return Performance(
            run_id=run.program.run_id,
            is_final=until is None and self.is_complete,
            indicators=indicators,
            streams=tuple(stream.count(end) for _, stream in streams),
            end_index=end,
            windows=windows,
            delays=tuple((name, stream.description.delay) for name, stream in streams),
            warnings=tuple(dict.fromkeys(warnings)),
        )

    def _end(self, until: int | None) -> int:
        """Return up to which sample every channel that sends at all has come, or `until`."""
        if until is not None:
            return until
        ends = [stream.end_index for stream in self._run.streams.values()]
        return min((end for end in ends if end), default=0)

    def waveforms(self, until: int | None = None) -> PeriodWaveforms:
        """
        Return the mean waveforms of rod and slider velocity over the free run.

        Parameters
        ----------
        until : int, optional
            See `performance`.

        """
        run = self._run
        if run.grid is None:
            return PeriodWaveforms(np.empty(0), {}, 0, run.reason)
        end = self._end(until)
        view = RunView(self.parameters, run.program, run.grid, run.streams, end)
        velocities, periods, reason = RunAnalysis(view).mean_velocities()
        return PeriodWaveforms(run.grid.phases, velocities, periods, reason)


def _grid_of(program: DriveProgram) -> tuple[PeriodGrid | None, str]:
    if all(segment.label != "hold" for segment in program.segments):
        return None, "the run has no steady drive"
    try:
        return PeriodGrid.of_program(program), ""
    except BadInputError as error:
        return None, f"the run has no steady drive ({error})"


def _check(description: ChannelDescription) -> None:
    name = description.name
    unit = _UNITS.get(name, description.unit)
    if description.unit != unit:
        raise BadInputError("has the wrong unit", where=name, value=description.unit, bound=unit)
    for key, low in (
        ("delay", -math.inf),
        ("resolution", 0.0),
        ("gain_uncertainty", 0.0),
        ("offset_uncertainty", 0.0),
        ("bandwidth", 0.0),
        ("high_pass_frequency", 0.0),
    ):
        value = getattr(description, key)
        if not (math.isfinite(value) and value >= low):
            raise BadInputError(
                "is out of bounds", where=f"{name}: {key}", value=value, bound=f"finite, >= {low:g}"
            )
