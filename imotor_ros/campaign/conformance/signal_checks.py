"""Checks on what a driver measured: the voltage, rod and slider, and how late each channel is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imotor_ros.campaign.conformance.programs import (
    FREQUENCIES,
    LEVEL,
    REPEAT,
    REPEATED,
    REST,
    SAWTOOTH,
    sine_label,
)
from imotor_ros.campaign.conformance.record import RunRecord
from imotor_ros.campaign.conformance.requirements import Findings
from imotor_ros.core.channel import (
    CURRENT,
    LOAD_FORCE,
    ROD_VELOCITY,
    SLIDER_VELOCITY,
    VOLTAGE,
    ChannelDescription,
)
from imotor_ros.core.channel_response import channel_response
from imotor_ros.core.linear_systems import Complex
from imotor_ros.core.samples import Samples

EARLIEST = -2e-6
"""Lag (s) left after the declared delays that is accepted below zero: nothing can lead."""

OUTPUT_LAG = 20e-6
"""Largest lag (s) of the voltage put out behind the voltage asked for."""

CLOCK_SLIP = 0.5
"""Largest change of a channel's lag through a run (samples)."""

GAIN_TOLERANCE = 0.05
"""Relative error of the voltage put out that is accepted beside the monitor's own."""

ROD_GAINS = (5e-9, 5e-6)
"""Displacements per volt (m/V) that piezoelectric stacks have."""

CAPACITANCES = (1e-9, 1e-4)
"""Capacitances (F) that piezoelectric stacks have."""

SLIDER_ACCELERATIONS = (1.0, 2e4)
"""Accelerations (m/s^2) that friction gives to sliders."""

WEAK = 10.0
"""A sine is seen if its amplitude is so many times its uncertainty."""

SLIDING = 0.5
"""The slider slides where it moves by less than this share of the rod's motion."""

_PARTS = 4

_MOVING = (ROD_VELOCITY, SLIDER_VELOCITY)

_GRID = 512
"""Points of a period in which the sign of the relative velocity is taken."""


@dataclass(frozen=True)
class Sine:
    """
    A sine in the samples of a channel.

    Attributes
    ----------
    phasor : complex
        Amplitude and phase against index 0 of the run (unit of the channel).
    uncertainty : float
        Standard uncertainty of its real and imaginary part, by the scatter of parts.

    """

    phasor: complex
    uncertainty: float

    @property
    def is_seen(self) -> bool:
        """Whether it stands out of the noise."""
        return abs(self.phasor) > WEAK * self.uncertainty and abs(self.phasor) > 0.0


def fit_sine(samples: Samples, first: int, frequency: float, sample_rate: float) -> Sine:
    """
    Fit a sine, a mean and a slope to samples, in parts of whole periods.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        Samples of a channel.
    first : int
        Index of the first of them in the run.
    frequency, sample_rate : float
        Of the sine and of the samples (Hz).

    """
    period = sample_rate / frequency
    part = max(1, int(len(samples) / period / _PARTS)) * period
    phasors = []
    for i in range(_PARTS):
        begin, end = round(i * part), round((i + 1) * part)
        index = np.arange(begin, min(end, len(samples)), dtype=np.float64)
        if len(index) < 8:
            break
        turn = 2.0 * np.pi * (((first + index) * (frequency / sample_rate)) % 1.0)
        basis = np.column_stack(
            (np.sin(turn), np.cos(turn), np.ones_like(index), index - index.mean())
        )
        a, b, *_ = _least_squares(basis, samples[begin : begin + len(index)])
        phasors.append(complex(a, b))
    values = np.asarray(phasors)
    scatter = float(np.sqrt(np.mean(np.abs(values - values.mean()) ** 2) / max(1, len(values) - 1)))
    return Sine(complex(values.mean()), scatter)


def _least_squares(basis: Samples, samples: Samples) -> Samples:
    """Return the coefficients; by the normal equations, as the columns are nearly orthogonal."""
    scale = 1.0 / np.sqrt((basis * basis).sum(axis=0))
    scaled = basis * scale
    return np.asarray(scale * np.linalg.solve(scaled.T @ scaled, scaled.T @ samples))


class RunSignals:
    """
    The channels of one run, looked at segment by segment.

    Parameters
    ----------
    record : RunRecord
        A run that came to its end.

    """

    def __init__(self, record: RunRecord) -> None:
        self._record = record
        self._asked = record.asked()
        self._samples = {name: record.samples(name) for name in record.blocks}
        self.rate = record.program.sample_rate

    def channel(self, name: str) -> ChannelDescription | None:
        """Return what is said of a channel."""
        described = self._record.descriptions.get(name)
        return described.channel if described else None

    def has(self, label: str) -> bool:
        """Whether the program has a segment."""
        return any(segment.label == label for segment in self._record.program.segments)

    @property
    def sines(self) -> tuple[tuple[str, float], ...]:
        """Segments with a steady sine, slow ones first; of a recorded run, its steady drive."""
        own = tuple((sine_label(f), f) for f in FREQUENCIES if self.has(sine_label(f)))
        if own or not self.has("hold"):
            return own
        return (("hold", self._record.program.fundamental_frequency),)

    def window(self, label: str, skipped: float = 0.3) -> slice:
        """Return the samples of a segment, less the share at its start in which it settles."""
        start, end = self._record.program.span(label)
        return slice(start + int(skipped * (end - start)), end)

    def asked(self, window: slice) -> Samples:
        """Return the voltage (V) asked for in a window."""
        return self._asked[window]

    def measured(self, name: str, window: slice) -> Samples:
        """Return the samples of a channel in a window."""
        return self._samples.get(name, np.empty(0))[window]

    def asked_sine(self, label: str, frequency: float) -> Sine:
        """Return the sine asked for in a segment (V)."""
        window = self.window(label)
        return fit_sine(self._asked[window], window.start, frequency, self.rate)

    def sine(self, name: str, label: str, frequency: float) -> Sine | None:
        """Return the sine of the quantity in a segment, what its channel does to it taken out."""
        window, channel = self.window(label), self.channel(name)
        samples = self.measured(name, window)
        if channel is None or len(samples) < window.stop - window.start:
            return None
        seen = fit_sine(samples, window.start, frequency, self.rate)
        response = complex(channel_response(channel, frequency))
        # what a digitiser of few steps hides
        floor = channel.resolution / math.sqrt(12.0 * len(samples))
        size = max(abs(response), 1e-3)
        return Sine(seen.phasor / response, math.hypot(seen.uncertainty, floor) / size)

    def harmonics(self, name: str, label: str, frequency: float, count: int) -> Complex:
        """Return phasors of the first harmonics of a quantity in a segment, shape (count,)."""
        window, channel = self.window(label), self.channel(name)
        assert channel is not None
        samples = self.measured(name, window)
        orders = np.arange(1, count + 1)
        index = window.start + np.arange(len(samples), dtype=np.float64)
        turn = 2.0 * np.pi * np.outer((index * (frequency / self.rate)) % 1.0, orders)
        basis = np.column_stack(
            (np.sin(turn), np.cos(turn), np.ones_like(index), index - index.mean())
        )
        fit = _least_squares(basis, samples)
        phasors = fit[:count] + 1j * fit[count : 2 * count]
        return np.asarray(phasors / channel_response(channel, orders * frequency))


# ---- voltage ---------------------------------------------------------------------------------


def check_voltage(signals: RunSignals, findings: Findings) -> None:
    """Check the voltage monitor against the voltage asked for: level, sines, lag, and the end."""
    channel = signals.channel(VOLTAGE)
    if channel is None:
        findings.skips("V1", "no voltage monitor is described")
        return
    texts: list[str] = []
    defects = [*_level_defects(signals, channel, texts), *_sine_defects(signals, channel, texts)]
    findings.judge("V1", defects, ", ".join(texts))


def _level_defects(
    signals: RunSignals, channel: ChannelDescription, texts: list[str]
) -> Iterator[str]:
    for label in (LEVEL, REST):
        if not signals.has(label):
            continue
        window = signals.window(label, 0.5)
        wanted = float(signals.asked(window).mean())
        found = signals.measured(VOLTAGE, window)
        if not found.size:
            yield f"no sample of the monitor where {wanted:.4g} V were asked for"
            continue
        shown = float(found.mean())
        error = 4.0 * (channel.gain_uncertainty * abs(wanted) + channel.offset_uncertainty)
        bound = error + channel.resolution + 0.02 * abs(wanted) + 0.1
        texts.append(f"{shown:.2f} V at {wanted:g} V")
        if abs(shown - wanted) > bound:
            yield (
                f"monitor shows {shown:.4g} V where {wanted:.4g} V were asked for (± {bound:.2g} V)"
            )


def _sine_defects(
    signals: RunSignals, channel: ChannelDescription, texts: list[str]
) -> Iterator[str]:
    for label, frequency in signals.sines:
        asked = signals.asked_sine(label, frequency)
        seen = signals.sine(VOLTAGE, label, frequency)
        if seen is None or abs(asked.phasor) == 0.0:
            continue
        ratio = seen.phasor / asked.phasor
        bound = GAIN_TOLERANCE + 4.0 * channel.gain_uncertainty
        if abs(abs(ratio) - 1.0) > bound:
            yield (
                f"monitor shows {abs(seen.phasor):.4g} V of the {abs(asked.phasor):.4g} V asked "
                f"for at {frequency:g} Hz (ratio {abs(ratio):.3f}, expected 1 ± {bound:.2g})"
            )
            continue
        lag = -math.atan2(ratio.imag, ratio.real) / (2.0 * math.pi * frequency)
        texts.append(f"ratio {abs(ratio):.4f} and lag {lag * 1e6:.2f} us at {frequency:g} Hz")
        if not EARLIEST <= lag <= OUTPUT_LAG:
            yield (
                f"voltage lags that asked for by {lag * 1e6:.1f} us at {frequency:g} Hz "
                f"(allowed {EARLIEST * 1e6:g} to {OUTPUT_LAG * 1e6:g} us)"
            )
            return


# ---- identity --------------------------------------------------------------------------------


def check_identity(signals: RunSignals, findings: Findings) -> None:
    """
    Check that rod and slider are not swapped, and that both point forward.

    Where the slider slides, it can follow the rod only as far as friction accelerates it, while the
    rod follows the voltage: the faster the sine, the less the slider moves. The rod goes forward as
    the voltage grows, and the slider in the mean under the sawtooth, while the rod stays.
    """
    if not signals.sines:
        findings.skips("A1", "the program has no steady sine")
        return
    label, frequency = signals.sines[-1]
    rod, slider = (signals.sine(c, label, frequency) for c in (ROD_VELOCITY, SLIDER_VELOCITY))
    if rod is None or slider is None or not (rod.is_seen or slider.is_seen):
        findings.skips("A1", "rod and slider show no motion")
        return
    share = abs(slider.phasor) / max(abs(rod.phasor), 1e-12)
    if share > 1.0 / SLIDING:
        findings.fails("A1", _why_slider_moves_more(signals, share))
        return
    texts: list[str] = []
    defects = [*_rod_defects(signals, texts)]
    if share < SLIDING:
        defects += _slider_defects(abs(slider.phasor), frequency, texts)
        defects += _forward_defects(signals, texts)
    else:
        texts.append("the slider does not slide: its direction was not checked")
    defects += _current_defects(signals, texts)
    findings.judge("A1", defects, ", ".join(texts))


def _why_slider_moves_more(signals: RunSignals, share: float) -> str:
    """
    Return what may be the cause of a slider that moves more than the rod in the fastest sine.

    The slower the sine, the better the slider follows the rod. With the two swapped it seems
    the other way round; with a wrong unit both are wrong by the same factor.
    """
    label, frequency = signals.sines[-1]
    text = f"at {frequency:g} Hz slider/velocity shows {share:.3g} times the motion of rod/velocity"
    label, frequency = signals.sines[0]
    rod, slider = (signals.sine(c, label, frequency) for c in _MOVING)
    if len(signals.sines) < 2 or rod is None or slider is None or not rod.is_seen:
        return f"channels swapped, or a wrong unit: {text}"
    slow = abs(slider.phasor) / abs(rod.phasor)
    text += f", at {frequency:g} Hz {slow:.3g} times"
    if slow < share:
        return f"channels swapped: {text}, but it is the rod that follows the voltage"
    return f"wrong unit of slider/velocity or rod/velocity: {text}"


def _rod_defects(signals: RunSignals, texts: list[str]) -> Iterator[str]:
    label, frequency = signals.sines[0]
    voltage = signals.asked_sine(label, frequency)
    rod = signals.sine(ROD_VELOCITY, label, frequency)
    if rod is None or not rod.is_seen:
        yield f"rod/velocity does not follow the voltage at {frequency:g} Hz"
        return
    gain = rod.phasor / (voltage.phasor * 2j * math.pi * frequency)
    angle = math.degrees(math.atan2(gain.imag, gain.real))
    texts.append(f"rod moves by {abs(gain) * 1e6:.4f} um/V at {angle:.0f} degrees")
    low, high = ROD_GAINS
    if not low <= abs(gain) <= high:
        yield (
            f"rod/velocity means {abs(gain):.3g} m/V, which no stack does ({low:g} to {high:g}): "
            "is the unit wrong?"
        )
    if abs(angle) > 135.0:
        yield "rod/velocity has the wrong sign: the rod goes back as the voltage grows"
    elif abs(angle) > 45.0:
        yield f"rod/velocity is {angle:.0f} degrees off the voltage's slope at {frequency:g} Hz"


def _current_defects(signals: RunSignals, texts: list[str]) -> Iterator[str]:
    label, frequency = signals.sines[-1]
    voltage, current = signals.asked_sine(label, frequency), signals.sine(CURRENT, label, frequency)
    if current is None:
        return
    if not current.is_seen:
        yield f"drive/current does not follow the voltage at {frequency:g} Hz"
        return
    ratio = current.phasor / (voltage.phasor * 2j * math.pi * frequency)
    texts.append(f"the current is that of {abs(ratio) * 1e6:.3f} uF")
    low, high = CAPACITANCES
    if not low <= abs(ratio) <= high:
        yield (
            f"drive/current means {abs(ratio):.3g} F, which no stack has ({low:g} to {high:g}): "
            "is the unit wrong?"
        )
    if ratio.real < 0.0:
        yield "drive/current has the wrong sign: it flows against the rising voltage"


def _slider_defects(amplitude: float, frequency: float, texts: list[str]) -> Iterator[str]:
    # friction makes a triangle of the velocity, whose first harmonic is 8/pi^2 of its height
    acceleration = amplitude * math.pi**2 / 8.0 * 4.0 * frequency
    texts.append(f"the slider slides and is accelerated by {acceleration:.4g} m/s^2")
    low, high = SLIDER_ACCELERATIONS
    if not low <= acceleration <= high:
        yield (
            f"slider/velocity is accelerated by {acceleration:.3g} m/s^2 while it slides, which "
            f"friction does not do ({low:g} to {high:g}): is the unit wrong?"
        )


def _forward_defects(signals: RunSignals, texts: list[str]) -> Iterator[str]:
    if not signals.has(SAWTOOTH):
        return
    window = signals.window(SAWTOOTH, 0.5)
    rod, slider = (signals.measured(c, window) for c in (ROD_VELOCITY, SLIDER_VELOCITY))
    of_slider, of_rod = signals.channel(SLIDER_VELOCITY), signals.channel(ROD_VELOCITY)
    if of_slider is None or of_rod is None or of_slider.high_pass_frequency > 0.0:
        return
    mean, still = float(slider.mean()), float(rod.mean())
    peak = float(np.abs(rod).max(initial=0.0))
    texts.append(f"slider at {mean * 1e3:.2f} mm/s under a sawtooth, rod at {still * 1e3:.2f} mm/s")
    noise = 4.0 * of_slider.offset_uncertainty + of_slider.resolution
    if mean < -max(noise, 0.02 * peak):
        yield f"slider/velocity has the wrong sign: {mean:.3g} m/s under a drive that goes forward"
    if abs(still) > max(4.0 * of_rod.offset_uncertainty + of_rod.resolution, 0.05 * peak):
        yield f"rod/velocity has a mean of {still:.3g} m/s, but the rod cannot travel"


# ---- alignment -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lag:
    """A lag (s), and its standard uncertainty (s)."""

    value: float
    uncertainty: float


def check_alignment(
    signals: RunSignals, streams: Sequence[str], findings: Findings, tolerance: float
) -> Mapping[str, Lag]:
    """
    Check each channel's lag behind the voltage monitor, with the declared delays taken out.

    Parameters
    ----------
    signals : RunSignals
        The run with the sines.
    streams : sequence of str
        The channels.
    findings : Findings
        Receives what is found.
    tolerance : float
        Largest lag (s) left.

    Returns
    -------
    mapping
        The lags that could be measured, by channel.

    """
    lags: dict[str, Lag] = {}
    if len(signals.sines) < len(FREQUENCIES):
        findings.skips("A2", "the program has not the sines that tell a delay")
        return lags
    reference = {f: signals.sine(VOLTAGE, sine_label(f), f) for f in FREQUENCIES}
    for name in (ROD_VELOCITY, CURRENT):
        lag = _lag_behind_voltage(signals, name, reference)
        if name in streams and lag is not None:
            lags[name] = lag
    slider = _lag_behind_rod(signals)
    if slider is not None:
        lags[SLIDER_VELOCITY] = slider
    _judge_lags(signals, lags, findings, tolerance)
    unseen = [name for name in streams if name not in (*lags, VOLTAGE)]
    for name in unseen:
        reason = "no load acts in this check" if name == LOAD_FORCE else "its sines are too weak"
        findings.skips("A2", f"{name}: {reason}")
    return lags


def _judge_lags(
    signals: RunSignals, lags: Mapping[str, Lag], findings: Findings, tolerance: float
) -> None:
    for name, lag in lags.items():
        channel = signals.channel(name)
        declared = 0.0 if channel is None else channel.delay
        of = "the rod" if name == SLIDER_VELOCITY else "the voltage"
        room = 3.0 * lag.uncertainty
        text = f"{name} {lag.value * 1e6:+.2f} ± {lag.uncertainty * 1e6:.2f} us"
        if lag.value < EARLIEST - room:
            findings.fails(
                "A2",
                f"{text}: it leads {of}, so its declared delay of {declared * 1e6:.2f} us is too "
                "long, or that of the other too short",
            )
        elif lag.value > tolerance + room:
            findings.fails(
                "A2",
                f"{text}: it lags {of} by more than the declared delay of {declared * 1e6:.2f} us "
                f"explains (allowed {tolerance * 1e6:g} us)",
            )
        else:
            findings.passes("A2", f"{text} behind {of}")


def _lag_behind_voltage(
    signals: RunSignals, name: str, reference: Mapping[float, Sine | None]
) -> Lag | None:
    """
    Return the delay that shows in how the phase falls with frequency.

    Rod velocity and current are a derivative of the voltage with a lag by hysteresis that is the
    same at all frequencies: what falls in proportion to the frequency is delay.
    """
    frequencies, phases, weights = [], [], []
    for frequency, voltage in reference.items():
        seen = signals.sine(name, sine_label(frequency), frequency)
        if seen is None or voltage is None or not seen.is_seen or not voltage.is_seen:
            continue
        ratio = seen.phasor / (voltage.phasor * 1j * frequency)
        relative = seen.uncertainty / abs(seen.phasor) + voltage.uncertainty / abs(voltage.phasor)
        frequencies.append(frequency)
        phases.append(math.atan2(ratio.imag, ratio.real))
        weights.append(1.0 / math.hypot(relative, 2e-3))
    if len(frequencies) < 3:
        return None
    turns = -2.0 * np.pi * np.asarray(frequencies)
    basis = np.column_stack((np.ones_like(turns), turns)) * np.asarray(weights)[:, None]
    values = np.unwrap(phases) * np.asarray(weights)
    covariance = np.linalg.inv(basis.T @ basis)
    _, lag = covariance @ (basis.T @ values)
    return Lag(float(lag), float(np.sqrt(covariance[1, 1])))


def _lag_behind_rod(signals: RunSignals) -> Lag | None:
    """
    Return the lag of the slider's channel behind the rod's, in sines in which the slider slides.

    Friction alone accelerates the slider, and depends on the relative velocity alone: with its
    sign, and maybe in proportion to it. The lag is that by which the slider's motion has to be
    shifted for this to hold best.
    """
    values, weights = [], []
    for label, frequency in signals.sines:
        rod, slider = (signals.sine(c, label, frequency) for c in (ROD_VELOCITY, SLIDER_VELOCITY))
        if rod is None or slider is None or not rod.is_seen or not slider.is_seen:
            continue
        if abs(slider.phasor) > 0.4 * abs(rod.phasor):
            continue  # it sticks for a part of the period
        values.append(_sliding_lag(signals, label, frequency))
        relative = slider.uncertainty / abs(slider.phasor) + rod.uncertainty / abs(rod.phasor)
        weights.append((2.0 * math.pi * frequency / math.hypot(relative, 5e-3)) ** 2)
    if not values:
        return None
    mean = float(np.average(values, weights=weights))
    scatter = float(np.std(values)) / math.sqrt(len(values))
    return Lag(mean, math.hypot(scatter, 1.0 / math.sqrt(sum(weights))))


def _sliding_lag(signals: RunSignals, label: str, frequency: float) -> float:
    """Return the lag (s) with which the slider's acceleration fits friction best."""
    count = max(1, min(9, int(min(50e3, 0.2 * signals.rate) / frequency)))
    rod, slider = (signals.harmonics(c, label, frequency, count) for c in _MOVING)
    orders = np.arange(1, count + 1)
    turn = np.exp(2j * np.pi * np.outer(np.arange(_GRID) / _GRID, orders))
    back = 2j / _GRID * turn.conj()

    def misfit(lag: float) -> float:
        shifted = slider * np.exp(2j * np.pi * orders * frequency * lag)
        relative = rod - shifted
        motion = np.imag(turn @ relative)
        sign = np.sign(motion) @ back
        basis = np.column_stack((sign, relative))
        acceleration = 1j * orders * shifted
        stacked = np.vstack((basis.real, basis.imag))
        wanted = np.concatenate((acceleration.real, acceleration.imag))
        solution, left, *_ = np.linalg.lstsq(stacked, wanted, rcond=None)
        is_friction = solution[0] > 0.0 and left.size > 0  # half a period off it would brake
        return float(left[0] if is_friction else wanted @ wanted)

    coarse = _least(misfit, 0.0, 60e-6, 61)
    return _least(misfit, coarse, 2e-6, 41)


def _least(function: Callable[[float], float], middle: float, span: float, steps: int) -> float:
    """Return where a function is least on a grid."""
    grid = middle + np.linspace(-span, span, steps)
    return float(grid[int(np.argmin([function(float(at)) for at in grid]))])


def check_clock(signals: RunSignals, streams: Sequence[str], findings: Findings) -> None:
    """Check that no channel slips between a sine and its return: one clock, no lost sample."""
    first = sine_label(REPEATED)
    if not (signals.has(first) and signals.has(REPEAT)):
        findings.skips("A3", "the program has no sine that comes again")
        return
    asked = [signals.asked_sine(label, REPEATED).phasor for label in (first, REPEAT)]
    for name in streams:
        pair = [signals.sine(name, label, REPEATED) for label in (first, REPEAT)]
        before, after = pair
        if before is None or after is None or not (before.is_seen and after.is_seen):
            findings.skips("A3", f"{name}: its sines are too weak")
            continue
        turn = (after.phasor / asked[1]) / (before.phasor / asked[0])
        slip = -math.atan2(turn.imag, turn.real) / (2.0 * math.pi * REPEATED) * signals.rate
        error = sum(one.uncertainty / abs(one.phasor) for one in (before, after))
        room = 3.0 * error / (2.0 * math.pi * REPEATED) * signals.rate
        text = f"{name} {slip:+.3f} samples"
        if abs(slip) > CLOCK_SLIP + room:
            findings.fails("A3", f"{text}: it slips against the voltage during the run")
        else:
            findings.passes("A3", text)
