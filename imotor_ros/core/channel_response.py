"""What a channel makes of the quantity it measures, as far as its description tells."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from imotor_ros.core.channel import BESSEL_3, FIRST_ORDER, ChannelDescription
from imotor_ros.core.linear_systems import (
    Complex,
    LinearSystem,
    bessel_low_pass,
    first_order_high_pass,
    first_order_low_pass,
)

_LOW_PASSES: Mapping[str, Callable[[float], LinearSystem]] = {
    BESSEL_3: bessel_low_pass,
    FIRST_ORDER: first_order_low_pass,
}


def channel_response(channel: ChannelDescription, frequency: ArrayLike) -> Complex:
    """
    Return the complex gain of a channel, samples over quantity, to divide it out.

    Parameters
    ----------
    channel : ChannelDescription
        The channel.
    frequency : array_like, shape (...)
        Frequencies (Hz) above zero.

    Returns
    -------
    ndarray of complex, shape (...)
        Low-pass, high-pass and delay. A low-pass of unknown kind counts as a pure delay.

    Notes
    -----
    `ChannelDescription.delay` is that of all parts at low frequency; what the low-pass itself
    contributes is taken off it, so that its dispersion counts once.
    """
    at = np.asarray(frequency, dtype=np.float64)
    value = np.ones(at.shape, dtype=np.complex128)
    delay = channel.delay
    if channel.low_pass in _LOW_PASSES and channel.bandwidth > 0.0:
        low_pass = _LOW_PASSES[channel.low_pass](channel.bandwidth)
        value = value * low_pass.frequency_response(at)
        delay -= low_pass.delay
    if channel.high_pass_frequency > 0.0:
        value = value * first_order_high_pass(channel.high_pass_frequency).frequency_response(at)
    return np.asarray(value * np.exp(-2j * np.pi * at * delay))
