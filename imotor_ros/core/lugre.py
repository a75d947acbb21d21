"""
LuGre friction: a contact that is elastic before it slides, for the virtual motor.

Bristles between rod and slider deflect by z and give way as they are dragged,

    dz/dt = w - sigma_0 |w| z / g(|w|),    F = sigma_0 z + sigma_1 dz/dt + sigma_2 w,
    g(w) = F_d + (F_0 - F_d) exp(-(w / v_s)^2),      w = v_R - v_S.

In steady sliding F is the Stribeck law g(w) + sigma_2 w. Sticking is a spring: below break-away the
slider moves against the rod a little, and there is no moment at which it breaks away. Such a
contact is what friction identification is tried on beyond the paper's assumptions; the solvers of
the models know laws without memory only.

C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, "A New Model for Control of Systems with
Friction", IEEE Transactions on Automatic Control 40 (1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.friction import FrictionNumbers
from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.core.samples import checked_sample_rate, checked_samples
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.stepping import SliderResponse
from imotor_ros.errors import BadInputError

Array = NDArray[np.float64]

# Bristles are followed in steps of this share of a radian of the slider on their spring.
_STEP = 0.02
_FEWEST_STEPS = 4


@dataclass(frozen=True)
class LuGreFriction(Parameters):
    """A contact with elastic bristles; by default stiff, on the line of equation (8)."""

    sliding_force: float = parameter(
        0.940, "sliding force F_d without the parts that depend on speed", unit="N", low=0.0,
        excludes_low=True, source="paper, equation (8)",
    )  # fmt: skip
    static_force: float = parameter(
        0.940, "sliding force F_0 at vanishing relative speed", unit="N", low=0.0,
        excludes_low=True, source="paper, equation (8): no Stribeck part",
    )  # fmt: skip
    slope: float = parameter(
        2.213, "viscous rise sigma_2 of the sliding force", unit="N s/m", low=0.0,
        source="paper, equation (8)",
    )  # fmt: skip
    decay_velocity: float = parameter(
        5e-3, "relative speed v_s at which the excess has decayed to 1/e", unit="m/s", low=1e-6,
        source="assumed",
    )  # fmt: skip
    stiffness: float = parameter(
        5e7, "stiffness sigma_0 of the bristles", unit="N/m", low=1e3, high=1e12,
        source="assumed: 20 nm at break-away",
    )  # fmt: skip
    damping: float = parameter(
        30.0, "damping sigma_1 of the bristles", unit="N s/m", low=0.0,
        source="assumed: a twentieth of critical for a slider of 7 g",
    )  # fmt: skip

    @property
    def numbers(self) -> FrictionNumbers:
        """
        A law without memory, which this is not.

        Raises
        ------
        BadInputError
            Always: only the virtual motor knows this law.

        """
        raise BadInputError(
            "has a memory, which this solver does not know", where="friction.law", value="lugre",
            bound="coulomb, velocity or stribeck",
        )  # fmt: skip

    @property
    def break_away(self) -> float:
        """Largest force (N) of a contact that is pulled slowly."""
        return self.static_force

    def force(self, speed: ArrayLike) -> Array:
        """Return the magnitude (N) of the force in steady sliding at speeds >= 0 (m/s)."""
        speeds = np.asarray(speed, dtype=np.float64)
        decay = np.exp(-((speeds / self.decay_velocity) ** 2))
        excess = self.static_force - self.sliding_force
        return np.asarray(self.sliding_force + self.slope * speeds + excess * decay)

    def check(self) -> None:
        """Refuse a force at rest below the sliding force."""
        if self.static_force < self.sliding_force:
            raise BadInputError(
                "is below the sliding force", where="LuGreFriction.static_force",
                value=self.static_force, bound=f">= {self.sliding_force:g} N",
            )  # fmt: skip


class LuGreStepper:
    """
    Moves a slider with LuGre friction along with a sampled rod motion.

    The counterpart of `SliderStepper`: rod velocity and acceleration make a cubic between the
    samples, which is followed in shorter steps of a second-order scheme. Bristles that are
    dragged fast are solved by exponentials, so that they need no shorter steps still. A sample
    depends on the one before and on nothing else.

    Parameters
    ----------
    slider : SliderParameters
        Mass, inclination, constant outer forces.
    load : LoadParameters
        Spring, weight, end stops.
    friction : LuGreFriction
        Friction at the nominal contact force.
    sample_rate : float
        Samples per second (Hz).

    """

    def __init__(
        self,
        slider: SliderParameters,
        load: LoadParameters,
        friction: LuGreFriction,
        sample_rate: float,
    ) -> None:
        rate = checked_sample_rate(sample_rate)
        turn = math.sqrt(friction.stiffness * slider.friction_scale / slider.mass) / rate
        self._steps = max(_FEWEST_STEPS, math.ceil(turn / _STEP))
        self._step = 1.0 / rate
        numbers = load.numbers
        self._constants = np.array(
            [
                slider.mass, slider.axial_force - slider.weight_along_rod, slider.friction_scale,
                friction.stiffness, friction.damping, friction.slope, friction.sliding_force,
                friction.static_force - friction.sliding_force, friction.decay_velocity, *numbers,
            ]
        )  # fmt: skip
        self._state = np.zeros(5)
        self._has_started = False

    def process(self, rod_velocity: ArrayLike, rod_acceleration: ArrayLike) -> SliderResponse:
        """
        Take the next samples of the rod motion and return the slider's.

        Parameters
        ----------
        rod_velocity, rod_acceleration : array_like, shape (samples,)
            Rod motion at the samples (m/s, m/s^2).

        Returns
        -------
        SliderResponse
            At the same samples; `is_sticking` tells whether the bristles hold. The first sample
            ever is the start: slider at rest, bristles relaxed.

        Raises
        ------
        BadInputError
            If the arrays differ in shape or hold a number that is not finite.

        """
        velocity = checked_samples(rod_velocity, where="rod_velocity")
        acceleration = checked_samples(rod_acceleration, where="rod_acceleration")
        if velocity.shape != acceleration.shape:
            raise BadInputError(
                "has the wrong shape", where="rod_acceleration", value=acceleration.shape,
                bound=f"shape {velocity.shape}",
            )  # fmt: skip
        rows = np.empty((4, velocity.size))
        is_sticking = np.empty(velocity.size, dtype=np.bool_)
        _follow(
            velocity, acceleration, self._has_started, self._step, self._steps, self._constants,
            self._state, rows, is_sticking,
        )  # fmt: skip
        self._has_started = self._has_started or velocity.size > 0
        return SliderResponse(rows[0], rows[1], rows[2], rows[3], is_sticking)


@njit(cache=True, error_model="numpy", inline="always")
def _load_force(x: float, v: float, p: Array) -> float:
    """Return the force (N) of spring, weight and end stops, which never pull."""
    force = p[9] * (x - p[10]) + p[11]
    if p[14] > 0.0:
        if x > p[13]:
            force += max(p[14] * (x - p[13]) + p[15] * v, 0.0)
        elif x < p[12]:
            force += min(p[14] * (x - p[12]) + p[15] * v, 0.0)
    return float(force)


@njit(
    "void(Array(float64, 1, 'C', readonly=True), Array(float64, 1, 'C', readonly=True), boolean, "
    "float64, int64, float64[::1], float64[::1], float64[:, ::1], boolean[::1])",
    cache=True,
    error_model="numpy",
)
def _follow(
    rod_velocity: Array,
    rod_acceleration: Array,
    has_started: bool,
    step: float,
    steps: int,
    p: Array,
    state: Array,
    rows: Array,
    is_sticking: NDArray[np.bool_],
) -> None:
    """
    Fill position, velocity, load and friction force of the samples (kernel).

    The bristles hold while they give less than 95 % of what they can.

    `state` is position, velocity, bristle deflection, and rod velocity and acceleration at the
    last sample. Over a short step h with mean relative velocity w, the bristles go from z to
    z E + w (1 - E) / r with r = sigma_0 |w| / g and E = exp(-r h); the force is then linear in
    w, and so is the equation of motion. r follows from the w that comes out, in three rounds.
    """
    mass, push, scale = p[0], p[1], p[2]
    s0, s1, s2, base, excess, decay = p[3], p[4], p[5], p[6], p[7], p[8]
    x, v, z, r0, a0 = state[0], state[1], state[2], state[3], state[4]
    h = step / steps
    for i in range(rod_velocity.size):
        r1, a1 = rod_velocity[i], rod_acceleration[i]
        force = 0.0
        g = base + excess
        for j in range(steps if has_started else 0):
            t = (j + 0.5) * h
            difference = (r1 - r0) / step
            c2 = (3.0 * difference - 2.0 * a0 - a1) / step
            c3 = (a0 + a1 - 2.0 * difference) / (step * step)
            rod = r0 + (a0 + (c2 + c3 * t) * t) * t
            load = _load_force(x + 0.5 * h * v, v, p)
            w = rod - v
            dv, end = 0.0, z
            for _ in range(3):
                g = base
                if excess > 0.0:
                    g += excess * math.exp(-((w / decay) ** 2))
                rate = s0 * abs(w) / g
                left = math.exp(-rate * h)
                share = h if rate * h < 1e-9 else (1.0 - left) / rate
                fixed = scale * (0.5 * s0 * (z + z * left) + s1 * z * (left - 1.0) / h)
                gain = scale * (0.5 * s0 * share + s1 * share / h + s2)
                dv = (fixed + gain * (rod - v) - load + push) / (mass / h + 0.5 * gain)
                w = rod - v - 0.5 * dv
                end = z * left + share * w
            force = (mass * dv / h) + load - push
            x += h * (v + 0.5 * dv)
            v += dv
            z = end
        r0, a0, has_started = r1, a1, True
        rows[0, i], rows[1, i], rows[2, i], rows[3, i] = x, v, _load_force(x, v, p), force
        is_sticking[i] = s0 * abs(z) < 0.95 * g
    state[0], state[1], state[2], state[3], state[4] = x, v, z, r0, a0
