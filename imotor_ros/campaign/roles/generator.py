"""The signal generator: renders a drive program, a bounded number of samples ahead."""

from __future__ import annotations

from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.core.drive import DriveProgram
from imotor_ros.core.drive_limits import DriveLimits
from imotor_ros.errors import BadInputError


class GeneratorRole:
    """
    Renders a drive program block by block, a bounded number of samples ahead of the plant.

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
        self.program = program
        self.sent = 0
        self.consumed = 0
        self.is_stopping = False
        self._sequence = 0
        self._block_length = block_length
        self._allowance = window * block_length

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
        if count <= 0 or self.sent + count - self.consumed > self._allowance:
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

        Whatever the program's limits are, a stop keeps to them: see `DriveLimits.check_program`.
        """
        if not self.is_stopping:
            self.is_stopping = True
            self.program = self.program.stopped_at(self.sent)
        return self.program
