"""The slider on its rod, and what pushes against it: parameters of section 4 of the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from imotor_ros.core.parameters import Parameters, parameter
from imotor_ros.errors import BadInputError

GRAVITY = 9.81
"""Gravitational acceleration (m/s^2), section 4."""


@dataclass(frozen=True)
class SliderParameters(Parameters):
    """
    The slider: mass, inclination and constant outer forces (equations 1 to 5).

    The friction laws hold for the nominal contact force: rod horizontal, no outer normal force.
    At another contact force the whole friction force scales with it, F_f = mu F_c.
    """

    mass: float = parameter(
        6.92e-3, "mass of the slider", unit="kg", low=0.0, excludes_low=True, source="section 3"
    )
    inclination: float = parameter(
        0.0, "angle of the rod, positive if +x points upwards", unit="rad",
        low=-math.pi / 2, high=math.pi / 2, source="section 4",
    )  # fmt: skip
    clamp_force: float = parameter(
        5.0, "contact force by the rubber bands", unit="N", low=0.0,
        source="assumed: 1 N of friction at a coefficient of 0.2",
    )  # fmt: skip
    normal_force: float = parameter(
        0.0, "outer force that presses the slider on the rod", unit="N", source="section 4, F_z"
    )
    axial_force: float = parameter(
        0.0, "outer force on the slider along +x", unit="N", source="section 4, F_x"
    )

    @property
    def weight_along_rod(self) -> float:
        """Part of the weight (N) that pulls along -x."""
        return self.mass * GRAVITY * math.sin(self.inclination)

    @property
    def nominal_contact_force(self) -> float:
        """Contact force (N) for which the friction law holds."""
        return self.mass * GRAVITY + self.clamp_force

    @property
    def contact_force(self) -> float:
        """Contact force (N) between rod and slider."""
        return (
            self.mass * GRAVITY * math.cos(self.inclination) + self.clamp_force + self.normal_force
        )

    @property
    def friction_scale(self) -> float:
        """Contact force over the nominal one."""
        return self.contact_force / self.nominal_contact_force

    def check(self) -> None:
        """Refuse a slider that is lifted off its rod."""
        if self.contact_force <= 0.0:
            raise BadInputError(
                "leaves no contact force",
                where="SliderParameters.normal_force",
                value=self.normal_force,
                bound=f"> {self.normal_force - self.contact_force:g} N",
            )


class LoadNumbers(NamedTuple):
    """
    A load as numbers, for compiled code; lengths in m, forces in N, positive along -x.

    Without stops `stop_stiffness` and `stop_damping` are 0 and the stops at infinity.
    """

    spring_stiffness: float
    spring_position: float
    constant_force: float
    lower_stop: float
    upper_stop: float
    stop_stiffness: float
    stop_damping: float

    @property
    def depends_on_position(self) -> bool:
        """True unless the load is a constant force."""
        return self.spring_stiffness > 0.0 or self.stop_stiffness > 0.0


@dataclass(frozen=True)
class LoadParameters(Parameters):
    """What the slider works against: spring, weight, end stops. Forces are positive along -x."""

    spring_stiffness: float = parameter(
        0.0, "stiffness of the load spring", unit="N/m", low=0.0, source="section 6, figure 11"
    )
    spring_position: float = parameter(
        0.0, "slider position at which the spring is relaxed", unit="m", low=-1.0, high=1.0
    )
    constant_force: float = parameter(0.0, "constant load, a weight on a thread", unit="N")
    lower_stop: float = parameter(
        -10e-3, "slider position at which it touches the stop behind", unit="m", low=-10.0,
        high=10.0, source="assumed: the motor is 52 mm long",
    )  # fmt: skip
    upper_stop: float = parameter(
        10e-3, "slider position at which it touches the stop in front", unit="m", low=-10.0,
        high=10.0, source="assumed: the motor is 52 mm long",
    )  # fmt: skip
    stop_stiffness: float = parameter(
        20e3, "stiffness of each stop with its force sensor; 0: there are no stops", unit="N/m",
        low=0.0, source="assumed, below the critical 80 N/mm of figure 11",
    )  # fmt: skip
    stop_damping: float = parameter(
        5.0, "damping of each stop; a stop never pulls", unit="N s/m", low=0.0,
        source="assumed: a fifth of critical",
    )  # fmt: skip

    @classmethod
    def free(cls) -> LoadParameters:
        """Return no load at all: neither spring nor weight nor stops."""
        return cls(stop_stiffness=0.0, stop_damping=0.0)

    @property
    def numbers(self) -> LoadNumbers:
        """The load for compiled code."""
        has_stops = self.stop_stiffness > 0.0
        return LoadNumbers(
            self.spring_stiffness,
            self.spring_position,
            self.constant_force,
            self.lower_stop if has_stops else -math.inf,
            self.upper_stop if has_stops else math.inf,
            self.stop_stiffness,
            self.stop_damping if has_stops else 0.0,
        )

    def check(self) -> None:
        """Refuse stops that leave no way between them."""
        if self.stop_stiffness > 0.0 and self.lower_stop >= self.upper_stop:
            raise BadInputError(
                "is not below the upper stop",
                where="LoadParameters.lower_stop",
                value=self.lower_stop,
                bound=f"< {self.upper_stop:g} m",
            )
