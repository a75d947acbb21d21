"""Friction identification from the bag of a run with a stepped sine."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from imotor_ros.bag.reader import RunBag
from imotor_ros.contracts.topics import ROD_VELOCITY, SLIDER_VELOCITY
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.identification.identification import identify
from imotor_ros.core.identification.records import ChannelRecord, IdentificationParameters
from imotor_ros.core.identification.results import Identification
from imotor_ros.core.slider import SliderParameters
from imotor_ros.errors import BadInputError


def identify_bag(
    path: Path | str,
    parameters: IdentificationParameters | None = None,
    mass: float | None = None,
) -> Identification:
    """
    Identify the friction of the motor that a bag is of.

    Parameters
    ----------
    path : Path
        The bag.
    parameters : IdentificationParameters, optional
        How to evaluate.
    mass : float, optional
        Mass of the slider (kg); by default that in the bag's run info.

    Raises
    ------
    UnreadableFileError
        If the bag cannot be read.
    BadInputError
        If it lacks a velocity, was not driven by a stepped sine, or the mass is not known.

    """
    with RunBag(path) as bag:
        slider = _slider_of(bag)
        if mass is None and slider is None:
            raise BadInputError(
                "is unknown", where=f"{path}: slider mass",
                bound="a run info with the motor's parameters, or the mass given (--mass)",
            )  # fmt: skip
        records = read_channels(bag)
        known = mass if mass is not None else slider.mass if slider else 0.0
        return identify(
            bag.program,
            records[ROD_VELOCITY.name],
            records[SLIDER_VELOCITY.name],
            known,
            parameters,
            contact_scale=slider.friction_scale if slider else 1.0,
        )


def _slider_of(bag: RunBag) -> SliderParameters | None:
    """Return what the run info says of the slider, or None."""
    found: Any = bag.run_info
    for key in ("parameters", "stand", "motor", "slider"):
        found = found.get(key) if isinstance(found, Mapping) else None
    if not isinstance(found, Mapping) or "mass" not in found:
        return None
    return SliderParameters.from_mapping(found, f"{bag.path}: slider")


def read_channels(bag: RunBag) -> dict[str, ChannelRecord]:
    """
    Return both measured velocities of a run, whole, by channel name.

    Raises
    ------
    BadInputError
        If one of them is missing, not described, or sampled at another rate than the run says.

    """
    program, names = bag.program, (ROD_VELOCITY.name, SLIDER_VELOCITY.name)
    for name in names:
        if name not in bag.topics or name not in bag.channels:
            raise BadInputError(
                "is missing or not described", where=f"{bag.path}: {name}",
                bound="both velocities, measured",
            )  # fmt: skip
    samples = {name: np.full(program.length, np.nan) for name in names}
    flagged: dict[str, list[tuple[int, int, int]]] = {name: [] for name in names}
    for block in bag.blocks(*names):
        if block.sample_rate != program.sample_rate:
            raise BadInputError(
                "has another sample rate than the run", where=f"{bag.path}: {block.stream}",
                value=block.sample_rate, bound=f"{program.sample_rate:.12g} Hz",
            )  # fmt: skip
        first, end = block.first_index, min(block.end_index, program.length)
        place = samples[block.stream][first:end]
        # what comes twice is wrong once, nobody knows which
        flags = block.flags | (SampleFlag.GAP if np.isfinite(place).any() else 0)
        place[:] = block.samples[: place.size]
        if flags:
            flagged[block.stream].append((first, end, int(flags)))
    return {
        name: ChannelRecord(bag.channels[name], samples[name], tuple(flagged[name]))
        for name in names
    }
