"""
Procedures that measure in steps: each step is a trial, and what it shows decides the next.

A procedure is a generator: it yields trials, is sent the recording of each, and returns its
result. It knows nothing of how a trial is played: in process, by nodes, or on a rig.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.samples import Samples
from imotor_ros.errors import BadInputError

T = TypeVar("T")


@dataclass(frozen=True)
class Trial:
    """
    A drive program that a procedure wants played.

    Attributes
    ----------
    program : DriveProgram
        What to play; its run id is its own.
    stage : str
        What it is for, e.g. "cycle 1".
    cycle : int
        Number of corrections made before it.
    amplitude_error, phase_error : float
        Largest errors found so far (relative; rad), NaN before the first.

    """

    program: DriveProgram
    stage: str
    cycle: int = 0
    amplitude_error: float = math.nan
    phase_error: float = math.nan


@dataclass(frozen=True)
class Recording:
    """
    What was measured during a trial.

    Attributes
    ----------
    program : DriveProgram
        What was played.
    samples : mapping of str to ndarray, shape (program.length,)
        The measured channels, by name, from sample 0 on.
    channels : mapping of str to ChannelDescription
        What they are.
    flags : mapping of str to int
        By channel, bitwise or of `SampleFlag`: what holds for one of its blocks at least.

    """

    program: DriveProgram
    samples: Mapping[str, Samples]
    channels: Mapping[str, ChannelDescription]
    flags: Mapping[str, int] = field(default_factory=dict)

    def channel(self, name: str) -> tuple[Samples, ChannelDescription]:
        """
        Return samples and description of a channel.

        Raises
        ------
        BadInputError
            If it was not recorded.

        """
        if name not in self.samples or name not in self.channels:
            raise BadInputError(
                "was not recorded",
                where=f"{self.program.run_id}: {name}",
                bound="a measured channel",
            )
        return self.samples[name], self.channels[name]


Procedure = Generator[Trial, Recording, T]


def carry_out(procedure: Procedure[T], play: Callable[[Trial], Recording]) -> T:
    """
    Carry out a procedure and return its result.

    Parameters
    ----------
    procedure : Procedure
        What to carry out, fresh.
    play : callable
        Plays a trial and returns its recording.

    """
    try:
        trial = next(procedure)
        while True:
            trial = procedure.send(play(trial))
    except StopIteration as end:
        result: T = end.value
        return result
