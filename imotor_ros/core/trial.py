"""
Procedures that measure in steps: each step is a trial, and what it shows decides the next.

A procedure is a generator: it yields trials, is sent the recording of each, and returns its
result. It knows nothing of how a trial is played: in process, by nodes, or on a rig.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.samples import Samples
from imotor_ros.errors import BadInputError, DriveLimitError, ExcitationError

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


class Steps(Generic[T]):
    """
    A procedure step by step, for who plays its trials.

    Parameters
    ----------
    procedure : Procedure
        What to carry out, fresh.

    Attributes
    ----------
    trial : Trial or None
        The one to be played; None once there is a result.

    Raises
    ------
    DriveLimitError
        If a limit is in the way of the next trial.
    BadInputError
        If what is asked for makes no sense, before the first trial.
    ExcitationError
        If the procedure cannot use what was measured.

    """

    def __init__(self, procedure: Procedure[T]) -> None:
        self._procedure = procedure
        self._result: list[T] = []
        self.trial: Trial | None = None
        self._advance(None)

    @property
    def result(self) -> T:
        """What the procedure has found; there must be no trial left."""
        return self._result[0]

    def send(self, recording: Recording) -> None:
        """Give the recording of the trial, and go on to the next."""
        self._advance(recording)

    def _advance(self, recording: Recording | None) -> None:
        try:
            if recording is None:
                self.trial = next(self._procedure)
            else:
                self.trial = self._procedure.send(recording)
        except StopIteration as end:
            self.trial, self._result = None, [end.value]
        except DriveLimitError:
            raise
        except BadInputError as error:
            if recording is None:
                raise
            # not the user's input is bad, but what was measured
            raise ExcitationError(str(error)) from error


def carry_out(procedure: Procedure[T], play: Callable[[Trial], Recording]) -> T:
    """
    Carry out a procedure and return its result; see `Steps`.

    Parameters
    ----------
    procedure : Procedure
        What to carry out, fresh.
    play : callable
        Plays a trial and returns its recording.

    """
    steps = Steps(procedure)
    while steps.trial is not None:
        steps.send(play(steps.trial))
    return steps.result
