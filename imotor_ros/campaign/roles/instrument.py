"""Virtual instruments: from a stream of truth to a measured stream."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.contracts.blocks import SampleBlock, StreamLedger
from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.drive import DriveProgram


class Instrument(Protocol):
    """A virtual instrument: samples of the quantity in, measured samples out."""

    @property
    def channel(self) -> ChannelDescription:
        """What it measures, and how well."""

    def process(self, samples: ArrayLike) -> tuple[NDArray[np.float64], SampleFlag]:
        """Return the measured samples, shape (n,), and what holds for one of them at least."""


class InstrumentRole:
    """
    A virtual instrument between a stream of truth and a measured stream.

    Parameters
    ----------
    instrument : Instrument
        The instrument, fresh: it has measured nothing yet.
    program : DriveProgram
        The run.

    """

    def __init__(self, instrument: Instrument, program: DriveProgram) -> None:
        self._instrument = instrument
        self._ledger = StreamLedger(
            instrument.channel.name, program.run_id, sample_rate=program.sample_rate
        )

    @property
    def ledger(self) -> StreamLedger:
        """What has come of the truth."""
        return self._ledger

    @property
    def channels(self) -> tuple[ChannelDescription, ...]:
        """The one channel of the instrument."""
        return (self._instrument.channel,)

    def process(self, block: SampleBlock) -> SampleBlock:
        """
        Measure a block of truth.

        Raises
        ------
        SamplesLostError
            If the block does not follow the one before.

        """
        self._ledger.accept(block)
        samples, flags = self._instrument.process(block.samples)
        channel = self._instrument.channel
        passed_on = block.flags & SampleFlag.RAMPED_DOWN
        return block.derive(channel.name, channel.unit, samples, int(flags | passed_on))
