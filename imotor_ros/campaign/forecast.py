"""What a run would take: time, samples, voltage and space, before anything moves."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from imotor_ros.campaign.campaign import NamedPoint
from imotor_ros.campaign.plan import plan_run
from imotor_ros.core.drive_limits import program_demand
from imotor_ros.errors import DriveLimitError, RecordingError

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
        Of the drive (V), by the linear response of the motor's parameters: what the bench finds
        differs by some per cent.
    bag_size : int
        Size of the bag (bytes), estimated.
    problem : str
        Which limit it would exceed, what is needed and what is allowed; empty if none.

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
    plan = plan_run(point, Path())
    program = plan.program
    demand = program_demand(program)
    problem = ""
    try:
        plan.limits.check_program(program)
    except DriveLimitError as error:
        problem = str(error)
    return RunForecast(
        point.name,
        program.run_id,
        program.length / program.sample_rate,
        program.length,
        demand.lowest,
        demand.highest,
        BYTES_PER_SAMPLE * program.length,
        problem,
    )


def check_space(samples: int, folder: Path) -> None:
    """
    Check that the bags of runs find room, before any of them starts.

    Parameters
    ----------
    samples : int
        Samples in time, of all runs together.
    folder : Path
        Where the bags are to be; it exists.

    Raises
    ------
    RecordingError
        If there is too little room on its disk.

    """
    needed, free = BYTES_PER_SAMPLE * samples, shutil.disk_usage(folder).free
    if needed > free:
        raise RecordingError(
            f"{folder}: the disk is too full: the bags need about {needed / 1e6:.0f} MB, "
            f"{free / 1e6:.0f} MB are free"
        )
