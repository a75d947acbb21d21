"""Friction identification on a bench: carry out the run with a stepped sine, and evaluate it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Any

from imotor_ros.bag.identify import identify_bag
from imotor_ros.campaign.bench import Bench
from imotor_ros.campaign.campaign import Campaign, NamedPoint
from imotor_ros.campaign.driver import Driver
from imotor_ros.campaign.point import PointParameters
from imotor_ros.campaign.runner import DONE, CampaignEvent, CampaignFinished, run_campaign
from imotor_ros.core.identification.records import IdentificationParameters
from imotor_ros.core.identification.results import Identification
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters
from imotor_ros.core.stand import StandParameters
from imotor_ros.errors import BadInputError, RunError


def friction_campaign(
    stand: StandParameters,
    drive: SteppedSineParameters | None = None,
    *,
    seed: int = 1,
    driver: Driver | None = None,
    name: str = "friction",
) -> Campaign:
    """
    Return the campaign of one run that friction is identified from.

    Parameters
    ----------
    stand : StandParameters
        Motor and instruments.
    drive : SteppedSineParameters, optional
        The steps; by default 0.1 to 8 um and back at 2 kHz, 40 each way.
    seed : int
        Seed of all that is random in the run.
    driver : Driver, optional
        What it is measured with, by default the virtual motor.
    name : str
        Name of the campaign.

    """
    point = PointParameters(
        seed=seed, report_interval=0.0, drive=drive or SteppedSineParameters(), stand=stand
    )
    measured_with = driver or Driver()
    named = NamedPoint("stepped_sine", point, measured_with)
    return Campaign(name, "friction identification", (named,), measured_with)


def check_friction_campaign(campaign: Campaign, where: str = "campaign") -> None:
    """
    Refuse a campaign that is no friction identification.

    Raises
    ------
    BadInputError
        If it has not just one point, or that is not driven by a stepped sine.

    """
    if len(campaign.points) != 1:
        raise BadInputError(
            "does not have one point", where=where, value=len(campaign.points), bound="1"
        )
    drive = campaign.points[0].parameters.drive
    if not isinstance(drive, SteppedSineParameters):
        raise BadInputError(
            "is not driven by a stepped sine", where=where,
            bound="point: drive: kind: stepped_sine",
        )  # fmt: skip


def carry_out_identification(
    campaign: Campaign,
    bench: Bench,
    output: Path,
    parameters: IdentificationParameters | None = None,
    *,
    resume: bool = False,
    provenance: Callable[[], Mapping[str, Any]] = dict,
) -> Generator[CampaignEvent, None, Identification]:
    """
    Carry out the run of a friction campaign, yield what happens, and return what it tells.

    Parameters
    ----------
    campaign : Campaign
        One point with a stepped sine; see `friction_campaign`.
    bench : Bench
        Where; it must have been entered.
    output : Path
        Folder for the bag.
    parameters : IdentificationParameters, optional
        How to evaluate.
    resume, provenance
        See `run_campaign`.

    Raises
    ------
    BadInputError
        If the campaign is of another kind, or the run cannot be planned.
    RunError
        If the run fails.

    """
    check_friction_campaign(campaign)
    events = run_campaign(campaign, bench, output, resume=resume, provenance=provenance)
    for event in events:
        yield event
        if isinstance(event, CampaignFinished):
            result = event.results[0]
    if result.status != DONE:
        raise RunError(f"the run for the friction identification failed: {result.error}")
    return identify_bag(output / result.bag, parameters)


def identify_motor(
    stand: StandParameters,
    bench: Bench,
    output: Path,
    drive: SteppedSineParameters | None = None,
    parameters: IdentificationParameters | None = None,
    **more: Any,
) -> Identification:
    """
    Identify the friction of the motor on a stand by a run of its own.

    Parameters
    ----------
    stand : StandParameters
        Motor and instruments.
    bench : Bench
        Where to measure; it must have been entered.
    output : Path
        Folder for the bag.
    drive : SteppedSineParameters, optional
        The steps, by default those of the paper's figure 8.
    parameters : IdentificationParameters, optional
        How to evaluate.
    **more
        `seed`, `driver` and `name` of `friction_campaign`.

    Returns
    -------
    Identification
        `fits["coulomb"].friction` is the constant of equation (9), `fits["velocity"].friction` the
        line of equation (8), `friction` the law that describes the motor best. `fits` is empty
        where `reason` says why nothing was found.

    Raises
    ------
    RunError
        If the run fails.

    """
    campaign = friction_campaign(stand, drive, **more)
    events = carry_out_identification(campaign, bench, output, parameters)
    while True:
        try:
            next(events)
        except StopIteration as end:
            found: Identification = end.value
            return found
