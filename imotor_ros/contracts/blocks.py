"""Blocks of samples, the time of a sample, and the check that none is missing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imotor_ros.errors import BadInputError, SamplesLostError

NANOSECONDS = 1_000_000_000


def sample_time(epoch: int, index: int, sample_rate: float) -> int:
    """
    Return the time (ns since 1970) of sample `index`, rounded down, without rounding error.

    Parameters
    ----------
    epoch : int
        Time of sample 0 (ns since 1970).
    index : int
        Number of samples before this one.
    sample_rate : float
        Samples per second (Hz).

    """
    numerator, denominator = float(sample_rate).as_integer_ratio()
    return epoch + index * NANOSECONDS * denominator // numerator


@dataclass(frozen=True)
class SampleBlock:
    """
    Consecutive samples of one stream.

    Attributes
    ----------
    stream : str
        Name of the stream, which is that of its topic.
    run_id : str
        Run it belongs to.
    time : int
        Time of the first sample (ns since 1970).
    sequence : int
        Number of the block in its stream, from 0.
    first_index : int
        Number of samples of the run before this block.
    sample_rate : float
        Samples per second (Hz).
    unit : str
        SI unit of the samples.
    flags : int
        Bitwise or of `SampleFlag`.
    samples : ndarray, shape (count,)
        The samples (unit).

    """

    stream: str
    run_id: str
    time: int
    sequence: int
    first_index: int
    sample_rate: float
    unit: str
    flags: int
    samples: NDArray[np.float64]

    @property
    def end_index(self) -> int:
        """Number of samples of the run up to the end of this block."""
        return self.first_index + len(self.samples)

    def derive(
        self, stream: str, unit: str, samples: NDArray[np.float64], flags: int = 0
    ) -> SampleBlock:
        """Return a block of another stream for the same samples of the same run."""
        return SampleBlock(
            stream,
            self.run_id,
            self.time,
            self.sequence,
            self.first_index,
            self.sample_rate,
            unit,
            int(flags),
            samples,
        )


def stamp_error(block: SampleBlock, epoch: int, sample_rate: float) -> int:
    """Return by how much (ns) the time of a block is not that of its first sample."""
    return block.time - sample_time(epoch, block.first_index, sample_rate)


@dataclass
class StreamLedger:
    """
    Counts the samples of one stream and notices when some are missing.

    Attributes
    ----------
    stream : str
        Name of the stream.
    next_index, next_sequence : int
        What the next block must begin with.
    received, lost : int
        Samples that came, and that did not.
    flags : int
        Bitwise or of the flags of all blocks.

    """

    stream: str
    run_id: str = ""
    next_index: int = 0
    next_sequence: int = 0
    received: int = 0
    lost: int = 0
    flags: int = 0
    sample_rate: float = field(default=0.0)

    def accept(self, block: SampleBlock) -> None:
        """
        Count a block.

        Raises
        ------
        SamplesLostError
            If the block does not follow the one before; it is counted all the same.
        BadInputError
            If it belongs to another run, or its rate differs.

        """
        if not self.run_id:
            self.run_id, self.sample_rate = block.run_id, block.sample_rate
        if block.run_id != self.run_id:
            raise BadInputError(
                "belongs to another run",
                where=self.stream,
                value=block.run_id,
                bound=f"run {self.run_id}",
            )
        if block.sample_rate != self.sample_rate:
            raise BadInputError(
                "has another sample rate",
                where=self.stream,
                value=block.sample_rate,
                bound=f"{self.sample_rate:g} Hz",
            )
        expected, expected_sequence = self.next_index, self.next_sequence
        missing = block.first_index - expected
        self.lost += max(0, missing)
        self.received += len(block.samples)
        self.flags |= block.flags
        self.next_index = max(self.next_index, block.end_index)
        self.next_sequence = max(self.next_sequence, block.sequence + 1)
        if missing or block.sequence != expected_sequence:
            raise SamplesLostError(self.stream, expected, block.first_index)
