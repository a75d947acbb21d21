"""How runs are evaluated."""

from __future__ import annotations

from dataclasses import dataclass

from imotor_ros.core.parameters import Parameters, group, parameter


@dataclass(frozen=True)
class PlausibilityParameters(Parameters):
    """What channels may contradict each other and the drive program; see `plausibility`."""

    is_checked: bool = parameter(True, "whether a run that contradicts itself is refused")
    voltage_error: float = parameter(
        0.2, "largest distance of the voltage monitor from the drive program, relative, its lag "
        "left out", low=0.0, high=10.0,
        source="assumed: an amplifier of three times the highest frequency takes 5 %",
    )  # fmt: skip
    least_lead: float = parameter(
        5e-6, "time by which the voltage monitor may precede the drive program", unit="s", low=0.0,
        high=1.0, source="assumed: error of a declared delay",
    )  # fmt: skip
    largest_output_lag: float = parameter(
        25e-6, "time by which the voltage may follow the drive program", unit="s", low=0.0,
        high=1.0, source="assumed: lag of an amplifier of 10 kHz, and some samples",
    )  # fmt: skip
    clock_slip: float = parameter(
        0.5, "largest drift of the voltage monitor during the steady drive, in samples", low=0.0,
        high=1e6, source="one sample that is missing without notice makes 1",
    )  # fmt: skip
    rod_mean: float = parameter(
        0.02, "largest mean of the rod velocity over its amplitude, beside its offset", low=0.0,
        high=1.0, source="assumed: it is zero",
    )  # fmt: skip
    rod_motion_error: float = parameter(
        0.5, "largest distance of the rod velocity from that wanted, relative", low=0.0, high=10.0,
        source="assumed: hysteresis without correction makes 0.2",
    )  # fmt: skip
    slider_speed: float = parameter(
        1.2, "largest velocity of the slider over that of the rod", low=0.0, high=100.0,
        source="1 for a slider that friction drags; the rest for bandwidth and noise",
    )  # fmt: skip
    friction_agreement: float = parameter(
        0.95, "share of the slider's acceleration that friction has to explain", low=-1.0, high=1.0,
        source="1 by equation (1), and in all points of figure 12 as simulated",
    )  # fmt: skip
    lag_tolerance: float = parameter(
        3e-6, "lag between rod and slider beside their declared delays", unit="s", low=0.0,
        high=1.0, source="assumed: errors of declared delays; 0 in figure 12 as simulated",
    )  # fmt: skip
    current_error: float = parameter(
        0.5, "largest part of the current that does not follow the slope of the voltage", low=0.0,
        high=1.0, source="assumed: moving rod and hysteresis make 0.2",
    )  # fmt: skip
    largest_loss_angle: float = parameter(
        45.0, "largest angle between the current and the slope of the voltage, in degrees",
        low=0.0, high=180.0, source="assumed: hysteresis makes 4 to 19",
    )  # fmt: skip
    least_capacitance: float = parameter(
        1e-9, "least capacitance of a stack", unit="F", low=0.0, source="assumed"
    )
    largest_capacitance: float = parameter(
        100e-6, "largest capacitance of a stack", unit="F", low=0.0, source="assumed"
    )


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
    plausibility: PlausibilityParameters = group(PlausibilityParameters)
