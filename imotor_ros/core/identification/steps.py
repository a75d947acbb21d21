"""
What one step of the stepped sine tells: friction force, relative speed, phase, harmonics.

The slider's mean absolute acceleration is the total variation of its velocity over a period: for
a velocity that rises once and falls once,

    mean |a_S| = 2 f (max v_S - min v_S),

so that no measured velocity is ever differentiated. Highest and lowest points are those of the
waveform with corners that `corners` reconstructs from the harmonics.

Equation (6) of the paper is printed with a_S - a_R; its own sentence, and the force of 1 N that
it gives, ask for a_S alone, which is used here. While the slider slides all the time,
m mean |a_S| is the mean of the sliding force over the period, exactly, whatever the law.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.identification.corners import (
    TURN,
    CornerWaveform,
    fit_corners,
    fit_crossings,
    fit_smooth,
)
from imotor_ros.core.identification.harmonics import Harmonics
from imotor_ros.core.identification.stepped_sine import DriveStep
from imotor_ros.core.phases import trigonometric_value

Array = NDArray[np.float64]

POINTS = 512
"""Phases per period at which relative speeds are kept."""

FEWEST_HARMONICS = 5
"""Without so many harmonics below the low-pass, corners cannot be told from noise."""

MOST_HARMONICS = 40

SLIDER_SHARE, ROD_SHARE = 0.5, 0.9
"""Share of the bandwidth up to which harmonics of the slider and of the rod are used."""

_PHASES = TURN * (np.arange(POINTS) + 0.5) / POINTS
_FINE_PHASES = TURN * np.arange(4 * POINTS) / (4 * POINTS)
_SIGNIFICANT = 4.0

# More than two corners are taken where the relative velocity shows them and they fit; corners
# and relative velocity are found in turn.
_CLOSE_MISFIT = 0.5
_MOST_CROSSINGS = 10
_CROSSING_ROUNDS = 3


def harmonic_count(
    frequency: float, bandwidth: float, sample_rate: float, share: float = SLIDER_SHARE
) -> int:
    """
    Return how many harmonics of the drive are worth using.

    Those of the slider up to half the bandwidth of its channel, where a low-pass that differs from
    its description by a tenth changes them by no more than 2 %; those of the rod, which are
    small and hardly enter the force, further. And none above a fifth of the sample rate.
    """
    limit = min(share * bandwidth if bandwidth > 0.0 else math.inf, 0.2 * sample_rate)
    most = MOST_HARMONICS * share / SLIDER_SHARE
    return math.floor(min(limit / frequency, most) + 1e-9)


def free_harmonics(count: int) -> int:
    """Return how many of `count` harmonics the corner model leaves free."""
    return 5 if count >= 14 else 3 if count >= 8 else 1


@dataclass(frozen=True)
class HeadComparison:
    """
    First harmonics of both velocities, compared.

    Attributes
    ----------
    phase : float
        Phase of the slider's first harmonic behind the rod's (rad).
    amplitude_ratio : float
        First harmonic of the slider's velocity over that of the rod's.
    phase_noise : float
        Standard deviation of `phase` and `amplitude_ratio` by noise.
    excess_harmonic : float
        Third harmonic of the slider's velocity over its first, less what the rod's would be.

    """

    phase: float
    amplitude_ratio: float
    phase_noise: float
    excess_harmonic: float


def compare_heads(rod: Harmonics, slider: Harmonics) -> HeadComparison:
    """Return how the slider's velocity compares with the rod's."""
    first, ratio = slider.phasors[0], slider.phasors[0] / rod.phasors[0]
    return HeadComparison(
        phase=-cmath.phase(ratio),
        amplitude_ratio=float(abs(ratio)),
        phase_noise=math.hypot(slider.noise / abs(first), rod.noise / abs(rod.phasors[0])),
        excess_harmonic=_excess(rod, slider, 2),
    )


@dataclass(frozen=True)
class StepMeasurement(HeadComparison):
    """
    What was measured in one step; without the slider's mass, so as accelerations.

    Attributes
    ----------
    step : DriveStep
        The step.
    periods : int
        Number of drive periods that it rests on.
    rod_amplitude : float
        Displacement amplitude (m) of the rod's first harmonic.
    mean_acceleration, mean_acceleration_noise : float
        Mean absolute slider acceleration (m/s^2), and its standard deviation by noise.
    mean_relative_speed : float
        Mean absolute relative velocity (m/s), equation (7).
    mean_slider_speed : float
        Mean absolute slider velocity (m/s).
    odd_harmonics : tuple of float
        Harmonics 3, 5, 7, ... of the slider's velocity over its first.
    crossing_margin : float
        Rod acceleration where the relative velocity changes sign, over the slider's by friction.
        Below 1 the slider sticks there, above it slides on. NaN where no corner is seen.
    closest_approach : float
        Smallest relative speed at which the relative velocity turns round, over what noise makes
        of one: how closely the rod comes back to the slider without clearly overtaking it.
    rising_share : float
        Share of the period in which the slider velocity rises; 1/2 without outer force.
    drift : float
        Change of the slider's first harmonic from the first to the second half, relative.
    misfit : float
        Chi square of the slider's waveform per degree of freedom.
    rod, slider_harmonics : Harmonics
        The velocities, as measured.
    slider : CornerWaveform
        The slider velocity, without its mean.
    slider_mean : float
        Mean slider velocity (m/s), offset taken out.

    """

    step: DriveStep
    periods: int
    rod_amplitude: float
    mean_acceleration: float
    mean_acceleration_noise: float
    mean_relative_speed: float
    mean_slider_speed: float
    odd_harmonics: tuple[float, ...]
    crossing_margin: float
    closest_approach: float
    rising_share: float
    drift: float
    misfit: float
    rod: Harmonics
    slider_harmonics: Harmonics
    slider: CornerWaveform
    slider_mean: float

    def relative_speeds(self, slider_gain: complex = 1.0, rod_gain: float = 1.0) -> Array:
        """
        Return |v_R - v_S| (m/s) at equally spaced phases of the period, shape (POINTS,).

        Parameters
        ----------
        slider_gain : complex
            Factor on the slider velocity; its phase (rad of the fundamental) shifts it.
        rod_gain : float
            Factor on the rod velocity.

        """
        rod = trigonometric_value(self.rod.phasors, _PHASES)
        slider = self.slider.velocity(_PHASES + cmath.phase(slider_gain)) + self.slider_mean
        return np.abs(rod_gain * rod - abs(slider_gain) * slider)


def fit_waveform(
    rod: Harmonics, slider: Harmonics, agreement: complex = 1.0 + 0.0j
) -> CornerWaveform:
    """
    Return the slider velocity over a period, with corners if its harmonics show any.

    Parameters
    ----------
    rod, slider : Harmonics
        Measured velocities; the rod's tells where more than two corners are.
    agreement : complex
        Slider's over rod's first harmonic where the slider sticks: how the heads agree.

    """
    free = free_harmonics(slider.phasors.size)
    smooth = fit_smooth(slider.phasors, slider.noise, free)
    if smooth.chi_square < smooth.freedom + _SIGNIFICANT * math.sqrt(2.0 * smooth.freedom):
        return smooth
    two = fit_corners(slider.phasors, slider.noise, free)
    cut = fit_smooth(slider.phasors, slider.noise, slider.phasors.size)
    seen = rod.seen_as(agreement)
    found = [_with_crossings(seen, slider, start, free) for start in (two, cut)]
    best = min((one for one in found if one), key=lambda one: one.misfit, default=two)
    return best if best.misfit < two.misfit + _CLOSE_MISFIT else two


def _with_crossings(
    rod: Harmonics, slider: Harmonics, start: CornerWaveform, free: int
) -> CornerWaveform | None:
    """
    Return the slider velocity with a corner wherever the rod overtakes it; None if twice only.

    Where that is depends on the slider velocity: it is found in rounds, from `start`.
    """
    found = start
    for _ in range(_CROSSING_ROUNDS):
        crossings = _crossings(rod, found, slider.noise)
        if not 2 < crossings.size <= _MOST_CROSSINGS:
            return None
        found = fit_crossings(slider.phasors, slider.noise, free, crossings)
    return found


def _crossings(rod: Harmonics, slider: CornerWaveform, noise: float) -> Array:
    """
    Return the phases (rad) at which the relative velocity changes sign, rising.

    Between two of them it must exceed what noise makes of it.
    """
    relative = trigonometric_value(rod.phasors, _PHASES) - slider.velocity(_PHASES)
    clear = np.flatnonzero(np.abs(relative) > _clear_speed(rod, noise))
    changes = np.flatnonzero(np.diff(np.sign(relative[clear]), append=np.sign(relative[clear[:1]])))
    found = []
    for index in changes:
        first, last = clear[index], clear[(index + 1) % clear.size]
        last += POINTS if last < first else 0
        stretch = np.arange(first, last + 1)
        values = relative[stretch % POINTS]
        zero = int(np.flatnonzero(np.sign(values[1:]) != np.sign(values[0]))[0])
        share = values[zero] / (values[zero] - values[zero + 1])
        found.append(TURN * (stretch[zero] + share + 0.5) / POINTS % TURN)
    return np.sort(np.array(found))


def measure_step(
    step: DriveStep,
    frequency: float,
    rod: Harmonics,
    slider: Harmonics,
    *,
    slider_offset: float | None = None,
    agreement: complex = 1.0 + 0.0j,
) -> StepMeasurement:
    """
    Return what a step tells.

    Parameters
    ----------
    step : DriveStep
        The step.
    frequency : float
        Of the drive (Hz).
    rod, slider : Harmonics
        Measured velocities.
    slider_offset : float, optional
        Offset (m/s) of the slider's channel. Without it the slider is taken not to drift; the
        rod, which stays where it is, never does.
    agreement : complex
        Slider's over rod's first harmonic where the slider sticks: how the heads agree.

    """
    curve, seen = fit_waveform(rod, slider, agreement), rod.seen_as(agreement)
    mean = 0.0 if slider_offset is None else slider.mean - slider_offset
    slider_velocity = curve.velocity(_PHASES) + mean
    relative = np.abs(trigonometric_value(rod.phasors, _PHASES) - slider_velocity)
    first = slider.phasors[0]
    omega = TURN * frequency
    return StepMeasurement(
        **vars(compare_heads(rod, slider)),
        step=step,
        periods=slider.periods,
        rod_amplitude=float(abs(rod.phasors[0]) / omega),
        mean_acceleration=frequency * curve.total_variation,
        mean_acceleration_noise=frequency * curve.total_variation_noise,
        mean_relative_speed=float(relative.mean()),
        mean_slider_speed=float(np.abs(slider_velocity).mean()),
        odd_harmonics=tuple(np.abs(slider.phasors[2::2] / first).tolist()),
        crossing_margin=_crossing_margin(curve, seen.phasors, slider.phasors.size),
        closest_approach=_closest_approach(seen, curve, slider.noise),
        rising_share=_rising_share(curve),
        drift=float(abs(slider.drift / first)),
        misfit=curve.misfit,
        rod=rod,
        slider_harmonics=slider,
        slider=curve,
        slider_mean=mean,
    )


def _clear_speed(rod: Harmonics, noise: float) -> float:
    """Return the relative speed (m/s) beyond what noise makes of one."""
    return _SIGNIFICANT * math.hypot(rod.noise, noise) * math.sqrt(rod.phasors.size)


def _closest_approach(rod: Harmonics, slider: CornerWaveform, noise: float) -> float:
    relative = trigonometric_value(rod.phasors, _FINE_PHASES) - slider.velocity(_FINE_PHASES)
    rises = np.sign(np.diff(relative, append=relative[0]))
    turns = np.flatnonzero(rises != np.roll(rises, 1))
    return float(np.abs(relative[turns]).min(initial=np.inf) / _clear_speed(rod, noise))


def _rising_share(curve: CornerWaveform) -> float:
    points = curve.turning_points
    following = (*points[1:], *points[:1])
    pairs = zip(points, following, strict=True)
    return sum((b.phase - a.phase) % TURN for a, b in pairs if a.sign < 0) / TURN


def _excess(rod: Harmonics, slider: Harmonics, index: int) -> float:
    """Return a harmonic of the slider over its first, less that of a slider that sticks."""
    ratio = slider.phasors[0] / rod.phasors[0]
    left = (slider.phasors[index] - ratio * rod.phasors[index]) / slider.phasors[0]
    return float(np.abs(left))


def _crossing_margin(curve: CornerWaveform, rod: NDArray[np.complex128], resolved: int) -> float:
    """
    Return the rod's acceleration at a corner over half the jump of the slider's; NaN without.

    At a corner rod and slider have the same velocity, and friction changes sign. To slide on in
    the other direction, the slider must be left behind: the rod's acceleration must exceed the
    one that friction gives the slider, which is half the jump. The corner where the ratio is
    smaller counts. Where the slider sticks the ratio is below 1, or a little above where
    breaking away takes more force than sliding.

    The rod's acceleration is the mean over the time that the harmonics resolve, 20 us for 50 kHz;
    not so with more than two corners, which come from the relative velocity itself.
    """
    if curve.corners.size == 0:
        return math.nan
    orders = np.arange(1, rod.size + 1)
    share = np.sinc(orders / resolved) if curve.corners.size == 2 else 1.0
    rod_slope = trigonometric_value(1j * orders * share * rod, curve.corners)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.min(rod_slope / (0.5 * curve.slope_jumps)))
