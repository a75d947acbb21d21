"""How runs are evaluated."""

from __future__ import annotations

from dataclasses import dataclass

from imotor_ros.core.parameters import Parameters, parameter


@dataclass(frozen=True)
class EvaluatorParameters(Parameters):
    """What counts as contact, as settled, and as enough."""

    minimum_periods: int = parameter(
        5, "fewest whole drive periods that a mean may rest on", low=4, high=100000,
        source="assumed: halves of two periods at least",
    )  # fmt: skip
    guard_periods: int = parameter(
        2, "drive periods left out before contact", low=0, high=1000,
        source="assumed: contact in one period is seen in the next",
    )  # fmt: skip
    settling_level: float = parameter(
        1e-3, "distance from the steady value, relative, at which start-up is over", low=1e-6,
        high=0.1, source="a tenth of the 1 % of the start-up time, section 6",
    )  # fmt: skip
    velocity_drift_bound: float = parameter(
        5e-3, "largest change between the halves of the free run, relative", low=0.0, high=1.0,
        source="assumed: half the 1 % of the start-up time, section 6",
    )  # fmt: skip
    force_drift_bound: float = parameter(
        2e-2, "largest change between the halves of the steady load, relative", low=0.0, high=1.0,
        source="assumed",
    )  # fmt: skip
    scatter_bound: float = parameter(
        5e-2, "largest standard error of a mean, relative, that noise from period to period does "
        "not explain", low=0.0, high=1.0, source="assumed",
    )  # fmt: skip
    contact_noise_factor: float = parameter(
        6.0, "load force that counts as contact, over its noise before the drive", low=1.0,
        high=1e3, source="assumed: once in a thousand million by chance",
    )  # fmt: skip
    contact_share: float = parameter(
        1e-3, "least load force that counts as contact, over the range of its channel", low=0.0,
        high=1.0, source="assumed",
    )  # fmt: skip
    contact_persistence: int = parameter(
        3, "drive periods in a row that must show the contact", low=1, high=1000, source="assumed"
    )
