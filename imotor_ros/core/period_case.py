"""
What stays the same in every period of a closed-form solution: fixed phases and tables over them.

Symbols as in `closed_form`: relative velocity w, rod acceleration alpha = a_R / omega, decay
Lambda = c / (m omega), levels G_+ and G_-, periodic response h. Phases are in rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.phases import level_phases, monotone_nodes, trigonometric_value
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Spectrum = NDArray[np.complex128]

TURN = 2.0 * math.pi


class SlidingTable(NamedTuple):
    """
    The solution for one sign of sliding, over the gaps between its fixed phases.

    Attributes
    ----------
    knots : ndarray, shape (m,)
        Phases 0, those where alpha = G_s, and 2 pi.
    is_away : ndarray of bool, shape (m - 1,)
        Whether w moves away from zero between one and the next.
    keep, add : ndarray, shape (m - 1,)
        w at the end of such a gap is add + keep * w at its start.
    response : ndarray, shape (m, 2)
        h and its integral at the knots.

    """

    knots: Array
    is_away: NDArray[np.bool_]
    keep: Array
    add: Array
    response: Array


@dataclass(frozen=True)
class PeriodCase:
    """
    Rod motion, friction and constant force as tables over one period.

    Attributes
    ----------
    omega : float
        Fundamental angular frequency (rad/s).
    decay : float
        Lambda.
    levels : tuple of float
        G_+ and G_- (m/s).
    turns_while_sliding : bool
        True if a constant force exceeds the sliding force at rest, and friction rises with
        speed: the slider's velocity may then turn while it slides.
    velocity, response : ndarray of complex, shape (n,)
        Coefficients of v_R = Re sum of V_k exp(i k theta), and of h (m/s).
    sliding : tuple of SlidingTable
        For s = +1 and s = -1.
    regions : ndarray, shape (q,)
        Phases 0, those where the force for sticking equals the break-away force, and 2 pi.
    region_sides : ndarray of int, shape (q - 1,)
        0 where sticking is possible between two of them, else the sign of breaking away.
    exit_gaps : ndarray of int, shape (q,)
        Gap in which sliding begins that starts at such a phase.
    exit_values : ndarray, shape (q, 4)
        h, its integral and v_R there, and w at the end of that gap.
    rests, rest_velocities : ndarray
        Phases where a_R = 0, between 0 and 2 pi, and v_R there.

    """

    omega: float
    decay: float
    levels: tuple[float, float]
    turns_while_sliding: bool
    velocity: Spectrum
    response: Spectrum
    sliding: tuple[SlidingTable, SlidingTable]
    regions: Array
    region_sides: Integers
    exit_gaps: Integers
    exit_values: Array
    rests: Array
    rest_velocities: Array

    @property
    def start_velocity(self) -> float:
        """Rod velocity (m/s) at phase 0."""
        return float(self.exit_values[0, 2])


def tabulate(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    load: LoadParameters | None,
) -> PeriodCase:
    """Find the fixed phases of a motion, law and constant load, and tabulate over them."""
    omega, law, scale = TURN * motion.fundamental_frequency, friction.numbers, slider.friction_scale
    inertia = slider.mass * omega
    ik = 1j * np.arange(1, motion.harmonics + 1)
    velocity = np.array(motion.amplitudes) * ik.imag * omega * np.exp(1j * np.array(motion.phases))
    decay = scale * law.slope / inertia
    response = velocity * ik / (ik + decay)

    outer = slider.axial_force - slider.weight_along_rod
    push = (outer - (load.constant_force if load else 0.0)) / inertia
    slide, stick = scale * law.force / inertia, scale * law.break_away / inertia
    levels = (push + slide, push - slide)
    # With equal forces the phases of break-away ARE those of the sliding tables.
    edges = levels if law.break_away == law.force else (push + stick, push - stick)

    alpha = velocity * ik
    nodes = monotone_nodes(alpha)
    sliding = (
        _sliding_table(alpha, response, decay, levels[0], 1, nodes),
        _sliding_table(alpha, response, decay, levels[1], -1, nodes),
    )
    regions, sides = _regions(alpha, edges, nodes)
    exit_gaps, exit_values = _exits(regions, sides, sliding, levels, decay, velocity, response)
    rests = level_phases(alpha, 0.0, nodes)[0][1:-1]
    return PeriodCase(
        omega=omega,
        decay=decay,
        levels=levels,
        turns_while_sliding=decay > 0.0 and abs(push) >= slide,
        velocity=velocity,
        response=response,
        sliding=sliding,
        regions=regions,
        region_sides=sides,
        exit_gaps=exit_gaps,
        exit_values=exit_values,
        rests=rests,
        rest_velocities=trigonometric_value(velocity, rests),
    )


def integrated(spectrum: Spectrum) -> Spectrum:
    """Return the coefficients of the integral over the phase, with zero mean."""
    return np.asarray(spectrum / (1j * np.arange(1, spectrum.size + 1)))


def _decay_over(decay: float, gone: Array) -> tuple[Array, Array]:
    """Return E and phi_1 over the phases gone."""
    if decay == 0.0:
        return np.ones_like(gone), gone
    return np.exp(-decay * gone), -np.expm1(-decay * gone) / decay


def _sliding_table(
    alpha: Spectrum, response: Spectrum, decay: float, level: float, sign: int, nodes: Array
) -> SlidingTable:
    # Mirrored for s = -1, so that a level just reached counts as not exceeded either way.
    knots, sides = level_phases(sign * alpha, sign * level, nodes)
    h = trigonometric_value(response, knots)
    keep, first = _decay_over(decay, np.diff(knots))
    add = h[1:] - h[:-1] * keep - level * first
    both = np.stack([h, trigonometric_value(integrated(response), knots)], axis=1)
    return SlidingTable(knots, sides > 0, keep, add, both)


def _regions(alpha: Spectrum, edges: tuple[float, float], nodes: Array) -> tuple[Array, Integers]:
    """Merge the phases of break-away in both directions."""
    above, above_sides = level_phases(alpha, edges[0], nodes)
    below, below_sides = level_phases(-alpha, -edges[1], nodes)
    phases = np.union1d(above, below)
    middle = 0.5 * (phases[1:] + phases[:-1])
    forward = above_sides[np.searchsorted(above, middle, side="right") - 1] > 0
    backward = below_sides[np.searchsorted(below, middle, side="right") - 1] > 0
    return phases, np.where(forward, 1, np.where(backward, -1, 0)).astype(np.int64)


def _exits(
    regions: Array,
    sides: Integers,
    sliding: tuple[SlidingTable, SlidingTable],
    levels: tuple[float, float],
    decay: float,
    velocity: Spectrum,
    response: Spectrum,
) -> tuple[Integers, Array]:
    """Tabulate the slides that begin where sticking ends."""
    gaps = np.zeros(regions.size, dtype=np.int64)
    h = trigonometric_value(response, regions)
    values = np.stack(
        [h, trigonometric_value(integrated(response), regions),
         trigonometric_value(velocity, regions), np.zeros(regions.size)], axis=1,
    )  # fmt: skip
    for j in range(1, regions.size - 1):
        if sides[j - 1] == 0 and sides[j] != 0:
            i = 0 if sides[j] > 0 else 1
            gaps[j] = gap = _gap_of_exit(sliding[i], float(regions[j]))
            keep, first = _decay_over(decay, sliding[i].knots[gap + 1] - regions[j : j + 1])
            end = sliding[i].response[gap + 1, 0]
            values[j, 3] = (end - h[j] * keep - levels[i] * first)[0]
    return gaps, values


def _gap_of_exit(table: SlidingTable, phase: float) -> int:
    """Return the gap in which a slide begins; by rounding its phase may lie just before."""
    last = table.is_away.size - 1
    gap = min(max(int(np.searchsorted(table.knots, phase, side="right")) - 1, 0), last)
    return gap if table.is_away[gap] or gap == last else gap + 1
