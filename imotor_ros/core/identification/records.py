"""What the identification is given: how to evaluate, and the two measured channels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.channel import ChannelDescription, SampleFlag
from imotor_ros.core.parameters import Parameters, parameter

Array = NDArray[np.float64]

_BAD_FLAGS = SampleFlag.OVER_RANGE | SampleFlag.DROP_OUT | SampleFlag.GAP


@dataclass(frozen=True)
class IdentificationParameters(Parameters):
    """How a run is evaluated."""

    threshold: float = parameter(
        10e-3, "smallest mean relative speed of a step that a law is fitted to", unit="m/s",
        low=0.0, high=10.0, source="section 5, beneath equation (7)",
    )  # fmt: skip
    settling_time: float = parameter(
        6e-3, "time left out at the start of a step", unit="s", low=0.0, high=60.0,
        source="five time constants of the mean slider velocity at the paper's largest step",
    )  # fmt: skip
    minimum_periods: int = parameter(
        6, "fewest whole periods that a step is evaluated over", low=4, high=100_000,
        source="assumed: enough to tell noise from change",
    )  # fmt: skip
    confidence: float = parameter(
        0.95, "share of the intervals that is to hold the truth", low=0.5, high=0.999
    )
    draws: int = parameter(2000, "resamplings of the bootstrap", low=100, high=1_000_000)
    seed: int = parameter(1, "seed of the bootstrap", low=0, high=2**63 - 1)
    leaves_out_bad_steps: bool = parameter(
        False, "whether to go on without steps whose samples are clipped, dropped or missing"
    )


@dataclass(frozen=True)
class ChannelRecord:
    """
    A channel of a run, all of it.

    Attributes
    ----------
    channel : ChannelDescription
        What it is.
    samples : ndarray, shape (n,)
        Its samples from sample 0 of the run on; NaN where samples are missing.
    flagged : tuple of (int, int, int)
        First sample, end and flags of every block that has flags.

    """

    channel: ChannelDescription
    samples: Array
    flagged: tuple[tuple[int, int, int], ...] = ()

    def fault(self, start: int, end: int) -> str:
        """Return what is wrong with the samples from `start` to before `end`; empty if nothing."""
        name, part = self.channel.name, self.samples[max(start, 0) : end]
        missing = end - max(start, 0) - part.size + int(np.count_nonzero(~np.isfinite(part)))
        if missing:
            return f"{missing} samples of {name} are missing"
        limit = self.channel.range - 1.5 * self.channel.resolution
        at_limit = int(np.count_nonzero(np.abs(part) >= limit)) if limit > 0.0 else 0
        if at_limit:
            return f"{at_limit} samples of {name} are at the end of its range"
        flags = 0
        for first, last, value in self.flagged:
            if first < end and last > start:
                flags |= value & _BAD_FLAGS
        if flags:
            words = SampleFlag(flags).name or ""
            return f"{name} is flagged {words.lower().replace('_', '-').replace('|', ', ')}"
        return ""
