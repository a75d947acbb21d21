"""An ideal, noise-free run in sampled time: the virtual plant's slider solver, by drive periods."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.signals import HarmonicMotion
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.solution import PeriodTable, check_start
from imotor_ros.core.stepping import SliderStepper
from imotor_ros.errors import BadInputError

Array = NDArray[np.float64]

_BLOCK = 1 << 17
_FEWEST_SAMPLES = 8


def simulate(
    motion: HarmonicMotion,
    slider: SliderParameters,
    friction: FrictionLaw,
    *,
    load: LoadParameters | None = None,
    periods: int,
    sample_rate: float,
) -> PeriodTable:
    """
    Step the slider from rest through sampled rod motion.

    Parameters
    ----------
    motion : HarmonicMotion
        Rod displacement.
    slider : SliderParameters
        Mass, inclination, constant outer forces.
    friction : FrictionLaw
        Friction law at the nominal contact force.
    load : LoadParameters, optional
        Spring, weight, end stops; none by default.
    periods : int
        Number of drive periods.
    sample_rate : float
        Samples per second (Hz); the period need not be a whole number of samples.

    Returns
    -------
    PeriodTable
        One row per period. Extremes are those of the samples; integrals over periods come from
        the samples' running sums, interpolated at the ends of the periods.

    Raises
    ------
    BadInputError
        If a number is out of bounds or the samples are too few for the highest harmonic.

    """
    check_start(periods, 0.0)
    stepper = SliderStepper(slider, load or LoadParameters.free(), friction, sample_rate)
    if sample_rate < _FEWEST_SAMPLES * motion.max_frequency:
        raise BadInputError(
            "is too low for the highest harmonic",
            where="sample_rate",
            value=sample_rate,
            bound=f">= {_FEWEST_SAMPLES * motion.max_frequency:g} Hz",
        )
    per_period = sample_rate * motion.period
    group = max(int(_BLOCK / per_period), 1)
    rows = np.empty((6, periods))
    carry = np.zeros((4, 1))
    following = 0
    for first in range(0, periods, group):
        count = min(group, periods - first)
        end = math.ceil((first + count) * per_period) + 1
        time = np.arange(following, end) / sample_rate
        rod_velocity = motion.velocity(time)
        response = stepper.process(rod_velocity, motion.acceleration(time))
        # The last two samples are those on both sides of the end: the next group starts there.
        block = np.stack(
            [rod_velocity - response.velocity, response.velocity, response.load_force,
             response.is_sticking.astype(np.float64)]
        )  # fmt: skip
        positions = response.position
        if first:
            block = np.concatenate([carry[:4], block], axis=1)
            positions = np.concatenate([carry[4], positions])
        origin = end - block.shape[1]
        edges = np.arange(first, first + count + 1) * per_period - origin
        rows[:, first : first + count] = _by_periods(block, positions, edges, 1.0 / sample_rate)
        carry, following = np.vstack([block[:, -2:], positions[-2:]]), end
    period = motion.period
    distance, slip, low, high, stick, force = rows
    return PeriodTable(
        period=period,
        mean_velocity=distance / period,
        min_velocity=low,
        max_velocity=high,
        mean_relative_speed=slip / period,
        stick_share=stick / period,
        mean_load_force=force / period,
        final_position=float(np.sum(distance)),
        final_velocity=float(carry[1, -1]),
    )


def _by_periods(block: Array, positions: Array, edges: Array, step: float) -> Array:
    """Return the rows of the periods whose ends are at `edges`, in samples of the block."""
    relative, velocity, force, is_sticking = block
    rows = np.empty((6, edges.size - 1))
    rows[0] = np.diff(_at(positions, velocity * step, edges))
    for row, values in ((1, np.abs(relative)), (4, is_sticking), (5, force)):
        sums = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) * step
        rows[row] = np.diff(_at(sums, values * step, edges))
    whole = np.ceil(edges).astype(np.int64)
    rows[2] = np.minimum.reduceat(velocity, whole[:-1])
    rows[3] = np.maximum.reduceat(velocity, whole[:-1])
    if whole[-1] < velocity.size:
        # reduceat runs to the end of the block: the last period ends before.
        rows[2, -1] = velocity[whole[-2] : whole[-1]].min()
        rows[3, -1] = velocity[whole[-2] : whole[-1]].max()
    return rows


def _at(values: Array, slopes: Array, edges: Array) -> Array:
    """Interpolate values with slopes (per sample) at `edges`, by cubics."""
    i = np.clip(np.floor(edges).astype(np.int64), 0, values.size - 2)
    u = edges - i
    rise = values[i + 1] - values[i]
    bend = 3.0 * rise - 2.0 * slopes[i] - slopes[i + 1]
    twist = slopes[i] + slopes[i + 1] - 2.0 * rise
    return np.asarray(values[i] + u * (slopes[i] + u * (bend + u * twist)))
