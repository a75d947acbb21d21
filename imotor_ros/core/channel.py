"""What a measured channel is, and what can be said of its samples."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

ROD_VELOCITY = "rod/velocity"
SLIDER_VELOCITY = "slider/velocity"
LOAD_FORCE = "load/force"
VOLTAGE = "drive/voltage_monitor"
CURRENT = "drive/current"

BESSEL_3 = "bessel_3"
FIRST_ORDER = "first_order"

MEASURED_CHANNELS = (ROD_VELOCITY, SLIDER_VELOCITY, LOAD_FORCE, VOLTAGE, CURRENT)


class SampleFlag(IntFlag):
    """What holds for at least one sample of a block; the numbers are those of SampleBlock.msg."""

    OVER_RANGE = 1
    DROP_OUT = 2
    VOLTAGE_CLIPPED = 4
    SLEW_LIMITED = 8
    CURRENT_LIMITED = 16
    GAP = 32
    RAMPED_DOWN = 64


def flag_names(flags: int) -> str:
    """Return the names of the flags that are set, e.g. "OVER_RANGE DROP_OUT"."""
    return " ".join(flag.name or "" for flag in SampleFlag if flag & flags)


@dataclass(frozen=True)
class ChannelDescription:
    """
    One measured channel: what its samples mean and which instrument made them.

    Attributes
    ----------
    name : str
        Name of the channel and of its topic, e.g. "slider/velocity".
    quantity : str
        Physical quantity, e.g. "velocity".
    unit : str
        SI unit of the samples.
    range : float
        Largest magnitude that is not over range (unit).
    resolution : float
        Smallest step (unit).
    gain_uncertainty : float
        Standard uncertainty of the calibration factor (relative).
    offset_uncertainty : float
        Standard uncertainty of the offset (unit).
    noise_density : float
        One-sided noise density (unit per square root of Hz).
    bandwidth : float
        Upper -3 dB frequency (Hz).
    high_pass_frequency : float
        Lower -3 dB frequency (Hz); 0 for a DC-coupled channel.
    delay : float
        Time by which the samples lag the quantity at low frequency (s).
    instrument, serial : str
        Make and model, and serial number.
    is_simulated : bool
        True for a virtual instrument.
    low_pass : str
        Kind of low-pass that makes the bandwidth, as in `channel_response`; empty if unknown.

    """

    name: str
    quantity: str
    unit: str
    range: float
    resolution: float = 0.0
    gain_uncertainty: float = 0.0
    offset_uncertainty: float = 0.0
    noise_density: float = 0.0
    bandwidth: float = 0.0
    high_pass_frequency: float = 0.0
    delay: float = 0.0
    instrument: str = ""
    serial: str = ""
    is_simulated: bool = True
    low_pass: str = ""
