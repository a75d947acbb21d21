"""
Friction laws of the contact between rod and slider.

The force on the slider is sgn(w) F(|w|), w = v_R - v_S, while it slides (equation 4 of the
paper); it sticks while the force needed for that is not above the break-away force (3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.errors import BadInputError

Array = NDArray[np.float64]


class FrictionNumbers(NamedTuple):
    """
    A law without memory as numbers, for compiled code.

    F(w) = force + slope w + excess exp(-(w / decay_velocity)^exponent), w = |v_R - v_S|.

    Attributes
    ----------
    force : float
        Constant part (N).
    slope : float
        Viscous part (N s/m).
    excess : float
        What the force at zero speed has above `force` (N); 0 for a straight line.
    decay_velocity : float
        Speed at which the excess has decayed to 1/e (m/s).
    exponent : float
        1 (Tustin's exponential) or 2 (Gaussian).
    break_away : float
        Largest force while sticking (N).

    """

    force: float
    slope: float
    excess: float
    decay_velocity: float
    exponent: float
    break_away: float


@runtime_checkable
class FrictionLaw(Protocol):
    """A law that gives the sliding force from the relative speed alone."""

    @property
    def break_away(self) -> float:
        """Largest force (N) while sticking, at the nominal contact force."""

    @property
    def numbers(self) -> FrictionNumbers:
        """The law for compiled code."""

    def force(self, speed: ArrayLike) -> Array:
        """Return the magnitude (N) of the sliding force at relative speeds >= 0 (m/s)."""


_BREAK_AWAY = "largest force while sticking; 0: the sliding force at zero relative speed"


@dataclass(frozen=True, kw_only=True)
class _SpeedFriction(Parameters):
    """What the laws have in common: break-away force, and evaluation from the numbers."""

    break_away_force: float = parameter(0.0, _BREAK_AWAY, unit="N", low=0.0)

    @property
    def numbers(self) -> FrictionNumbers:
        """The law for compiled code."""
        raise NotImplementedError

    @property
    def zero_speed_force(self) -> float:
        """Sliding force (N) at vanishing relative speed."""
        numbers = self.numbers
        return numbers.force + numbers.excess

    @property
    def break_away(self) -> float:
        """Largest force (N) while sticking, at the nominal contact force."""
        return self.break_away_force or self.zero_speed_force

    def force(self, speed: ArrayLike) -> Array:
        """Return the magnitude (N) of the sliding force at relative speeds >= 0 (m/s)."""
        law, speeds = self.numbers, np.asarray(speed, dtype=np.float64)
        decay = np.exp(-((speeds / law.decay_velocity) ** law.exponent))
        return np.asarray(law.force + law.slope * speeds + law.excess * decay)

    def check(self) -> None:
        """
        Refuse a break-away force below the sliding force.

        Between the two the contact could neither stick nor slide.
        """
        if 0.0 < self.break_away_force < self.zero_speed_force:
            raise BadInputError(
                "is below the sliding force at zero relative speed",
                where=f"{type(self).__name__}.break_away_force",
                value=self.break_away_force,
                bound=f"0 or >= {self.zero_speed_force:g} N",
            )


@dataclass(frozen=True)
class CoulombFriction(_SpeedFriction):
    """Constant sliding force: friction model 1 of the paper, equation (9)."""

    sliding_force: float = parameter(
        1.01, "sliding force", unit="N", low=0.0, excludes_low=True, source="paper, equation (9)"
    )

    @property
    def numbers(self) -> FrictionNumbers:
        """The law for compiled code."""
        return FrictionNumbers(
            self.sliding_force, 0.0, 0.0, 1.0, 2.0, self.break_away_force or self.sliding_force
        )


@dataclass(frozen=True)
class VelocityDependentFriction(_SpeedFriction):
    """Sliding force on a line over the relative speed: friction model 2, equation (8)."""

    sliding_force: float = parameter(
        0.940, "sliding force at zero relative speed", unit="N", low=0.0, excludes_low=True,
        source="paper, equation (8)",
    )  # fmt: skip
    slope: float = parameter(
        2.213, "rise of the sliding force with the relative speed", unit="N s/m", low=0.0,
        source="paper, equation (8)",
    )  # fmt: skip

    @property
    def numbers(self) -> FrictionNumbers:
        """The law for compiled code."""
        force = self.sliding_force
        return FrictionNumbers(force, self.slope, 0.0, 1.0, 2.0, self.break_away_force or force)


@dataclass(frozen=True)
class StribeckFriction(_SpeedFriction):
    """
    Sliding force that falls from its value at rest before it rises with the relative speed.

    F(w) = F_d + c w + (F_0 - F_d) exp(-(w / v_s)^p).
    """

    sliding_force: float = parameter(
        0.940, "sliding force F_d without the parts that depend on speed", unit="N", low=0.0,
        excludes_low=True, source="paper, equation (8)",
    )  # fmt: skip
    static_force: float = parameter(
        1.20, "sliding force F_0 at vanishing relative speed", unit="N", low=0.0,
        excludes_low=True, source="assumed",
    )  # fmt: skip
    slope: float = parameter(
        2.213, "viscous rise c of the sliding force", unit="N s/m", low=0.0,
        source="paper, equation (8)",
    )  # fmt: skip
    decay_velocity: float = parameter(
        5e-3, "relative speed v_s at which the excess has decayed to 1/e", unit="m/s", low=1e-6,
        source="assumed: stiction is gone at the paper's 10 mm/s",
    )  # fmt: skip
    exponent: int = parameter(
        2, "exponent p: 1 exponential, 2 Gaussian decay", low=1, high=2, source="Armstrong-Hélouvry"
    )

    @property
    def numbers(self) -> FrictionNumbers:
        """The law for compiled code."""
        return FrictionNumbers(
            self.sliding_force,
            self.slope,
            self.static_force - self.sliding_force,
            self.decay_velocity,
            float(self.exponent),
            self.break_away_force or self.static_force,
        )

    def check(self) -> None:
        """Refuse a force at rest below the sliding force, then what the base class refuses."""
        if self.static_force < self.sliding_force:
            raise BadInputError(
                "is below the sliding force",
                where="StribeckFriction.static_force",
                value=self.static_force,
                bound=f">= {self.sliding_force:g} N",
            )
        super().check()


FRICTION_LAWS: Mapping[str, type[Parameters]] = {
    "coulomb": CoulombFriction,
    "velocity": VelocityDependentFriction,
    "stribeck": StribeckFriction,
}
