"""What a run would take: time, samples, voltage and space, before anything moves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.plan import plan_run

BYTES_PER_SAMPLE = 36
"""Size of a bag over its samples in time: nine streams, compressed.

Measured on the twelve points of figure 12: 29 to 37.
"""


@dataclass(frozen=True)
class RunForecast:
    """
    What a run would take.

    Attributes
    ----------
    name, run_id : str
        The run.
    duration : float
        Length of its stream (s).
    samples : int
        Samples of each channel.
    lowest_voltage, highest_voltage : float
        Of the steady drive (V).
    bag_size : int
        Size of the bag (bytes), estimated.
    problem : str
        Which limit it would exceed; empty if none.

    """

    name: str
    run_id: str
    duration: float
    samples: int
    lowest_voltage: float
    highest_voltage: float
    bag_size: int
    problem: str


def forecast_run(point: NamedPoint) -> RunForecast:
    """
    Return what the run of a point would take.

    Raises
    ------
    BadInputError
        If the point cannot be planned.

    """
    program = plan_run(point, Path()).program
    first, end = program.span("hold")
    periods = round(2.0 * program.sample_rate / program.fundamental_frequency)
    voltage = program.render(first, min(end - first, periods))
    low, high = float(voltage.min()), float(voltage.max())
    amplifier = point.parameters.stand.motor.amplifier
    problem = ""
    if low < amplifier.lowest_voltage or high > amplifier.highest_voltage:
        problem = (
            f"the drive needs {low:.1f} to {high:.1f} V, the amplifier gives "
            f"{amplifier.lowest_voltage:g} to {amplifier.highest_voltage:g} V"
        )
    return RunForecast(
        point.name,
        program.run_id,
        program.length / program.sample_rate,
        program.length,
        low,
        high,
        BYTES_PER_SAMPLE * program.length,
        problem,
    )
