"""Drive programs: the same samples however they are cut, no jump, 0 V at the end."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imotor_ros.core.drive import DriveProgram, DriveSegment, steady_drive
from imotor_ros.errors import BadInputError

RATE = 1e6
EPOCH = 946_684_800 * 10**9


def a_run(hold: int = 2_000, frequency: float = 4625.0, rate: float = RATE) -> DriveProgram:
    """Return a run with two harmonics about 50 V."""
    return steady_drive(
        run_id="run",
        epoch=EPOCH,
        sample_rate=rate,
        fundamental_frequency=frequency,
        offset=50.0,
        amplitudes=(36.3, 11.7),
        phases=(0.3, -1.2),
        hold_time=hold / rate,
        bias_time=3e-4,
        ramp_periods=2.0,
    )


def a_sweep() -> DriveProgram:
    """Return ups and downs in frequency, amplitude and offset, in segments without jumps."""
    segments = (
        DriveSegment("bias", 300, 0.0, 0.0, 0.0, 40.0, (0.0,), (0.0,), (0.5,)),
        DriveSegment("up", 700, 2e3, 9e3, 40.0, 45.0, (0.0,), (30.0,), (0.5,)),
        DriveSegment("hold", 501, 9e3, 9e3, 45.0, 45.0, (30.0,), (30.0,), (0.5,)),
        DriveSegment("down", 899, 9e3, 500.0, 45.0, 40.0, (30.0,), (10.0,), (0.5,)),
        DriveSegment("ramp_down", 200, 500.0, 500.0, 40.0, 40.0, (10.0,), (0.0,), (0.5,)),
        DriveSegment("release", 300, 0.0, 0.0, 40.0, 0.0, (0.0,), (0.0,), (0.5,)),
    )
    return DriveProgram("sweep", EPOCH, RATE, 9e3, segments)


def rendered(program: DriveProgram) -> np.ndarray:
    """Return all samples."""
    return program.render(0, program.length)


def steepest(program: DriveProgram) -> float:
    """Return a bound of the voltage step between samples (V), from the segments alone."""
    bounds = []
    for one in program.segments:
        frequency = max(one.start_frequency, one.end_frequency)
        pairs = list(zip(one.start_amplitudes, one.end_amplitudes, strict=True))
        swing = sum(2 * math.pi * k * max(pair) for k, pair in enumerate(pairs, 1)) * frequency
        ramp = sum(abs(b - a) for a, b in pairs) + abs(one.end_offset - one.start_offset)
        bounds.append(swing / program.sample_rate + ramp / one.length)
    return max(bounds)


programs = st.sampled_from([a_run(), a_run(hold=1, frequency=18_500.0), a_sweep()])


@given(programs, st.integers(1, 3_000), st.integers(1, 3_000))
def test_samples_do_not_depend_on_the_blocks(
    program: DriveProgram, first: int, second: int
) -> None:
    """To the last bit, in blocks that alternate between two lengths."""
    pieces, place = [], 0
    for count in [first, second] * program.length:
        if place >= program.length:
            break
        pieces.append(program.render(place, count))
        place += count
    assert np.array_equal(np.concatenate(pieces)[: program.length], rendered(program))


def test_samples_one_by_one() -> None:
    program = a_sweep()
    single = [program.render(i, 1)[0] for i in range(program.length)]
    assert np.array_equal(single, rendered(program))


def test_voltage_before_and_after_is_that_of_the_ends() -> None:
    program = a_run()
    assert program.render(0, 1)[0] == 0.0
    assert np.array_equal(program.render(program.length, 5), np.zeros(5))
    assert program.render(3, 0).shape == (0,)


@pytest.mark.parametrize("program", [a_run(), a_run(hold=1), a_sweep()])
def test_voltage_has_no_jump_and_ends_at_zero(program: DriveProgram) -> None:
    voltage = np.concatenate([[0.0], rendered(program), [0.0]])
    assert np.max(np.abs(np.diff(voltage))) <= steepest(program) * (1 + 1e-9)


def test_steady_part_is_the_sum_of_its_harmonics_from_the_start_of_the_ramp() -> None:
    """Worked case: cycles count from the end of "bias", whose frequency is 0."""
    program = a_run()
    begin, _ = program.span("ramp_up")
    first, end = program.span("hold")
    angle = 2 * np.pi * 4625.0 * (np.arange(first, end) - begin) / RATE
    expected = 50.0 + 36.3 * np.sin(angle + 0.3) + 11.7 * np.sin(2 * angle - 1.2)
    # the phase of some ten cycles is good to 1e-14 turns
    assert np.allclose(program.render(first, end - first), expected, rtol=0, atol=1e-10)


def test_length_and_spans() -> None:
    program = a_run()
    ramp, slow = round(2.0 * RATE / 4625.0), 300
    assert program.length == 2 * slow + 2 * ramp + 2_000
    assert program.span("bias") == (0, slow)
    assert program.span("hold") == (slow + ramp, slow + ramp + 2_000)
    assert program.span("release")[1] == program.length
    with pytest.raises(BadInputError, match="drive program run: no such segment, got 'sweep'"):
        program.span("sweep")


def test_phase_of_a_sweep_is_the_integral_of_its_frequency() -> None:
    """Over several segments, against the phase summed up in extended precision."""
    program = a_sweep()
    cycles = 0.0
    for i, one in enumerate(program.segments):
        assert program._start_cycles[i] == pytest.approx(cycles % 1.0, abs=1e-12)
        mean = 0.5 * (one.start_frequency + one.end_frequency)
        cycles += one.length * mean / RATE
    first, end = program.span("down")
    index = np.arange(end - first, dtype=np.longdouble)
    share = index / (end - first)
    start = np.longdouble(sum(s.length * (s.start_frequency + s.end_frequency) for s in
                              program.segments[:3])) / (2 * RATE)  # fmt: skip
    turns = start + index * (9e3 + (500.0 - 9e3) * 0.5 * share) / RATE
    offset = 45.0 - 5.0 * share
    expected = offset + (30.0 - 20.0 * share) * np.sin(2 * np.pi * turns + 0.5)
    found = program.render(first, end - first)
    assert np.max(np.abs(found - expected.astype(float))) < 1e-9  # 30 V times 1e-11 of a turn


def test_long_hold_keeps_its_phase() -> None:
    """After 4000 s the phase is good to 1e-8 of a turn: index * frequency has 53 bits."""
    rate, seconds = 1e6, 4_000
    program = a_run(hold=seconds * 1_000_000, frequency=4625.0, rate=rate)
    first, _ = program.span("hold")
    begin, _ = program.span("ramp_up")
    late = first + seconds * 1_000_000 - 1_000
    angle = 2 * np.pi * ((4625 * (np.arange(late, late + 999) - begin)) % 1_000_000) / rate
    expected = 50.0 + 36.3 * np.sin(angle + 0.3) + 11.7 * np.sin(2 * angle - 1.2)
    assert np.max(np.abs(program.render(late, 999) - expected)) < 1e-5


# ---- stopping early ---------------------------------------------------------------------------


@given(programs, st.data())
def test_stopped_program_keeps_what_was_sent_and_ends_without_jump_at_zero(
    program: DriveProgram, data: st.DataObject
) -> None:
    index = data.draw(st.integers(0, program.length), label="index")
    stopped = program.stopped_at(index)
    assert stopped.length <= program.length
    assert (stopped.run_id, stopped.epoch) == (program.run_id, program.epoch)
    before = program.render(0, index)
    # cut segments are the same lines through other end points: equal but for rounding
    assert np.allclose(stopped.render(0, index), before, rtol=0, atol=1e-9)
    voltage = np.concatenate([[0.0], rendered(stopped), [0.0]])
    # the ramp down may be shorter than that of the segment it cuts
    steep = max(steepest(program), steepest(stopped)) * (1 + 1e-9)
    assert np.max(np.abs(np.diff(voltage))) <= steep + 1e-9
    assert stopped.segments[-1].end_offset == 0.0


@given(st.integers(0, 3_500), st.integers(1, 400), st.integers(1, 400))
def test_stop_takes_the_ramp_and_release_it_is_told(index: int, ramp: int, release: int) -> None:
    program = a_run()
    stopped = program.stopped_at(min(index, program.length), ramp, release)
    if index + ramp + release >= program.length:
        assert stopped is program
    else:
        assert stopped.length == index + ramp + release
        assert [s.label for s in stopped.segments[-2:]] == ["ramp_down", "release"]


def test_stopping_twice_is_stopping_at_the_first() -> None:
    program = a_run()
    once = program.stopped_at(1_500)
    assert once.stopped_at(1_600) is once, "it would end sooner by itself"


@pytest.mark.parametrize("index", [-1, 10**9])
def test_stop_outside_the_program_is_refused(index: int) -> None:
    with pytest.raises(BadInputError, match=f"index: is outside the program, got {index}"):
        a_run().stopped_at(index)


# ---- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"length": 0}, "x.length: is too short, got 0"),
        ({"phases": (0.0, 1.0)}, "x: has different numbers of amplitudes and phases"),
        ({"start_offset": math.nan}, "x: is not finite, got nan"),
        ({"end_amplitudes": (math.inf,)}, "x: is not finite, got inf"),
        ({"end_frequency": -math.inf}, "x: is not finite, got -inf"),
    ],
)
def test_bad_segment_is_refused(changes: dict[str, object], text: str) -> None:
    good = DriveSegment("x", 10, 1e3, 1e3, 0.0, 0.0, (1.0,), (1.0,), (0.0,))
    with pytest.raises(BadInputError, match=text):
        replace(good, **changes)  # type: ignore[arg-type]


def test_bad_program_is_refused() -> None:
    program = a_run()
    with pytest.raises(BadInputError, match="drive program run: has no segments"):
        replace(program, segments=())
    for rate in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(BadInputError, match="sample_rate: is out of bounds"):
            replace(program, sample_rate=rate)
