"""The signal generator: renders a drive program, a bounded number of samples ahead."""

from __future__ import annotations

from dataclasses import replace

from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.core.drive import DriveProgram, Ending
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.errors import BadInputError

STOP_TIME = 0.05
"""Longest stream time (s) from a stop to 0 V, counted from what the driver has consumed then."""

UNDER_WAY_TIME = 0.03
"""The part of it (s) that may be taken by what is under way: sent, but not consumed."""

BLOCK_TIME = 0.01
"""Longest block (s): a few fit in what may be under way, whatever the sample rate."""


class GeneratorRole:
    """
    Renders a drive program block by block, a bounded number of samples ahead of the plant.

    Whatever block length and window are, blocks are no longer than `BLOCK_TIME` and no more than
    `UNDER_WAY_TIME` is under way, so that a stop brings the voltage to zero within `STOP_TIME`.

    Parameters
    ----------
    program : DriveProgram
        What to play.
    block_length : int
        Samples in a block.
    window : int
        Blocks that may be under way: sent, but not consumed.
    limits : DriveLimits
        What may be sent at all; by default what the paper's motor allows.

    Raises
    ------
    DriveLimitError
        If the program needs more than the limits allow.
    BadInputError
        If it does not lead to 0 V.

    """

    def __init__(
        self,
        program: DriveProgram,
        block_length: int,
        window: int,
        limits: DriveLimits | None = None,
    ) -> None:
        self.limits = limits or DriveLimits()
        self.limits.check_program(program)
        _check_end(program)
        self.program = program
        self.sent = 0
        self.consumed = 0
        self._sequence = 0
        rate = program.sample_rate
        self._block_length = min(block_length, max(1, int(BLOCK_TIME * rate)))
        self._allowance = min(window * self._block_length, max(1, int(UNDER_WAY_TIME * rate)))

    @property
    def is_stopping(self) -> bool:
        """Whether the program was cut."""
        return self.program.ending is not Ending.PLANNED

    @property
    def is_voltage_on(self) -> bool:
        """Whether a driver may be putting out voltage."""
        return self.sent > 0 and not self.is_finished

    @property
    def is_finished(self) -> bool:
        """Whether the plant has consumed the whole program."""
        return self.consumed >= self.program.length

    def next_block(self) -> SampleBlock | None:
        """
        Return the next block, or None if nothing may be sent for now.

        Raises
        ------
        DriveLimitError
            If a sample of it is out of range, in spite of the program's check.

        """
        count = min(self._block_length, self.program.length - self.sent)
        is_full = self.sent + count - self.consumed > self._allowance
        if count <= 0 or is_full or self.program.ending is Ending.ABANDONED:
            return None
        program = self.program
        block = SampleBlock(
            stream=topics.DRIVE_VOLTAGE.name,
            run_id=program.run_id,
            time=sample_time(program.epoch, self.sent, program.sample_rate),
            sequence=self._sequence,
            first_index=self.sent,
            sample_rate=program.sample_rate,
            unit="V",
            flags=0,
            samples=self.limits.contain(program.render(self.sent, count), program.run_id),
        )
        self._sequence += 1
        self.sent += count
        return block

    def acknowledge(self, consumed: int) -> None:
        """
        Take note of what the plant has consumed.

        Raises
        ------
        BadInputError
            If it claims to have consumed what was not sent, or takes back what it had.

        """
        if not self.consumed <= consumed <= self.sent:
            raise BadInputError(
                "acknowledges the wrong number of samples",
                where=topics.DRIVE_PROGRESS.name,
                value=consumed,
                bound=f"{self.consumed} to {self.sent}",
            )
        self.consumed = consumed

    def stop(self) -> DriveProgram:
        """
        Cut the program at the next sample to be sent, bring the voltage to zero, return it.

        Amplitudes and offset go down as at the program's own end, but in what is left of
        `STOP_TIME` at the most. Whatever the program's limits are, a stop keeps to them: see
        `DriveLimits.check_program`.
        """
        if not self.is_stopping:
            program = self.program
            longest = max(1, int(0.5 * (STOP_TIME - UNDER_WAY_TIME) * program.sample_rate))
            ramp, release = (min(one.length, longest) for one in (program.segments * 2)[-2:])
            cut = program.stopped_at(self.sent, ramp, release)
            self.program = replace(cut, ending=Ending.STOPPED)
        return self.program

    def abandon(self) -> DriveProgram:
        """Send nothing more, and return the program that tells the driver so."""
        self.program = replace(self.program, ending=Ending.ABANDONED)
        return self.program


def _check_end(program: DriveProgram) -> None:
    """Refuse a program after which a voltage would stay."""
    last = program.segments[-1]
    rest = max(map(abs, (last.end_offset, *last.end_amplitudes)))
    if rest > 0.0:
        raise BadInputError(
            "does not lead to 0 V",
            where=f"{program.run_id}: end of {last.label}",
            value=rest,
            bound="end_offset and end_amplitudes 0 V",
        )
