"""The windows of a run that its indicators rest on: free run and load."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core import waveforms
from imotor_ros.core.channel import LOAD_FORCE, SLIDER_VELOCITY, SampleFlag
from imotor_ros.core.contact import Contact, ContactCriteria, find_contact
from imotor_ros.core.indicators import FREE_RUN, LOAD, Window
from imotor_ros.core.load_record import LoadRecord
from imotor_ros.core.period_statistics import SIGNIFICANT, noise_of, without_spikes
from imotor_ros.core.run_view import NotAvailable, RunView
from imotor_ros.core.steady_state import SteadyState, find_steady_state

Selection = NDArray[np.int64]


class RunWindows:
    """
    Free run and load of a run; periods are counted from the start of the drive.

    Parameters
    ----------
    view : RunView
        The run.

    """

    def __init__(self, view: RunView) -> None:
        self._view = view
        self.load_record = LoadRecord(view)

    @cached_property
    def contact(self) -> Contact:
        """When the slider is first hindered."""
        view, record = self._view, self.load_record
        has_velocity = not view.missing(SLIDER_VELOCITY)
        if record.reason and LOAD_FORCE in view.names and has_velocity:
            view.warn(f"contact is judged by the slider velocity alone: {record.reason}")
        criteria = ContactCriteria(
            threshold=math.nan if record.reason else record.threshold,
            persistence=view.parameters.contact_persistence,
            first=view.first,
        )
        contact = find_contact(
            self._velocity if has_velocity else None,
            None if record.reason else record.changes,
            criteria,
        )
        if contact.warning:
            view.warn(contact.warning)
        return contact

    @cached_property
    def _velocity(self) -> NDArray[np.float64]:
        """Period means of the slider velocity, those that a drop-out has spoiled smoothed over."""
        means = self._view.means(SLIDER_VELOCITY)
        has_drop_outs = self._view.flags(SLIDER_VELOCITY) & SampleFlag.DROP_OUT
        return without_spikes(means) if has_drop_outs else means

    @cached_property
    def free_end(self) -> int:
        """Period up to which the slider is not hindered for certain."""
        view, row = self._view, self.contact.row
        if row is None:
            return view.rows
        guard = view.parameters.guard_periods
        bandwidth = 0.0 if view.missing(LOAD_FORCE) else view.channel(LOAD_FORCE).bandwidth
        if bandwidth > 0.0:
            # a slow force channel tells of the contact late
            guard += math.ceil(0.5 * view.frequency / bandwidth)
        return max(row - guard, 0)

    def free_run(self) -> SteadyState:
        """
        Return the steady free run.

        Raises
        ------
        NotAvailable
            If there is none.

        """
        self._view.require(SLIDER_VELOCITY)
        state = self._free_state
        if state.reason:
            raise NotAvailable(state.reason)
        return state

    @cached_property
    def _free_state(self) -> SteadyState:
        view = self._view
        state = self._steady_state(
            self._velocity,
            view.first,
            self.free_end,
            view.parameters.velocity_drift_bound,
            "the velocity",
        )
        row = self.contact.row
        if not state.reason or row is None:
            return state
        time = row * view.period * 1e3
        reason = f"{state.reason}; contact {time:.4g} ms after the start of the drive"
        return dataclasses.replace(state, reason=reason)

    def load(self) -> SteadyState:
        """
        Return the steady part of the load.

        Raises
        ------
        NotAvailable
            If there is none.

        """
        if self.load_record.reason:
            raise NotAvailable(self.load_record.reason)
        if not self.contact.is_seen_by_force:
            raise NotAvailable("no contact with a stop or spring was seen")
        state = self._load_state
        if state.reason:
            raise NotAvailable(state.reason)
        return state

    @cached_property
    def _load_state(self) -> SteadyState:
        view = self._view
        begin = max(self.contact.row or 0, view.first)
        bound = view.parameters.force_drift_bound
        return self._steady_state(
            self.load_record.changes, begin, view.rows, bound, "the load force"
        )

    def _steady_state(
        self, means: NDArray[np.float64], first: int, end: int, bound: float, what: str
    ) -> SteadyState:
        parameters = self._view.parameters
        end = max(end, first)
        state = find_steady_state(
            self._view.times(first, end),
            means[first:end],
            minimum=parameters.minimum_periods,
            level=parameters.settling_level,
            bound=bound,
            scatter=parameters.scatter_bound,
            what=what,
        )
        return dataclasses.replace(state, first=state.first + first, end=state.end + first)

    def selection(self, *names: str) -> Selection:
        """
        Return the periods of the free run that no drop-out of the channels spoils.

        Raises
        ------
        NotAvailable
            If there is no free run, or too little is left of it.

        """
        state = self.free_run()
        every = rows = np.arange(state.first, state.end)
        for name in names:
            if self._view.flags(name) & SampleFlag.DROP_OUT:
                rows = np.intersect1d(rows, self._undisturbed(name, every), assume_unique=True)
        if rows.size < self._view.parameters.minimum_periods:
            raise NotAvailable(
                f"drop-outs of {' or '.join(names)} spoil all but {rows.size} of {every.size} "
                "periods of the free run"
            )
        return rows

    def _undisturbed(self, name: str, every: Selection) -> Selection:
        rows = waveforms.without_spoiled(self._view.waveforms(name), every)
        self._view.warn(
            f"{name} had drop-outs: {every.size - rows.size} of {every.size} periods of the free "
            "run are left out"
        )
        return rows

    def direction(self, end: int) -> float:
        """Return +1 or -1: the direction in which the slider has moved until period `end`."""
        if not self._view.missing(SLIDER_VELOCITY):
            velocity = self._view.means(SLIDER_VELOCITY)[:end]
            noise = noise_of(velocity) * math.sqrt(velocity.size)
            moved = float(np.sum(velocity))
            if abs(moved) > 2.0 * SIGNIFICANT * noise:
                return math.copysign(1.0, moved)
        self._view.warn(
            "the direction of motion is unknown: a force against forward motion counts as positive"
        )
        return 1.0

    def found(self) -> tuple[Window, ...]:
        """Return the windows that were found."""
        windows = []
        for name, finder in ((FREE_RUN, self.free_run), (LOAD, self.load)):
            try:
                state = finder()
            except NotAvailable:
                continue
            start, end = (self._view.grid.first_sample(row) for row in (state.first, state.end))
            windows.append(Window(name, start, end, state.end - state.first))
        return tuple(windows)
