"""The time of a sample in exact integers, and the ledger that notices what is missing."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imotor_ros.contracts.blocks import NANOSECONDS, SampleBlock, StreamLedger, sample_time
from imotor_ros.errors import BadInputError, SamplesLostError

EPOCH = 946_684_800 * NANOSECONDS


def a_block(first: int = 0, count: int = 10, sequence: int = 0, **changes: object) -> SampleBlock:
    """Return a block of the stream rod/velocity."""
    block = SampleBlock(
        "rod/velocity", "run", EPOCH, sequence, first, 1e6, "m/s", 0, np.zeros(count)
    )
    return replace(block, **changes)  # type: ignore[arg-type]


# ---- time ------------------------------------------------------------------------------------


@given(
    st.integers(0, 2**61),
    st.integers(0, 2**50),
    st.floats(1e-3, 1e9),
)
def test_sample_time_is_exact_and_rounded_down(epoch: int, index: int, rate: float) -> None:
    exact = epoch + Fraction(index * NANOSECONDS) / Fraction(rate)
    found = sample_time(epoch, index, rate)
    assert isinstance(found, int)
    assert found <= exact < found + 1


@pytest.mark.parametrize(
    ("index", "rate", "expected"),
    [
        (0, 3.0, 0),
        (1, 3.0, 333_333_333),
        (3, 3.0, 1_000_000_000),
        (3_600 * 10**6, 1e6, 3_600 * NANOSECONDS),
        (10**12 + 1, 1e6, 10**15 + 1_000),  # eleven days: doubles would be off by 100 ns
        (44_100 * 86_400, 44_100.0, 86_400 * NANOSECONDS),
        (1, 0.1, 9_999_999_999),  # the double 0.1 is a little more than a tenth
    ],
)
def test_sample_time_worked_cases(index: int, rate: float, expected: int) -> None:
    assert sample_time(EPOCH, index, rate) == EPOCH + expected


def test_sample_time_takes_the_numbers_of_numpy() -> None:
    assert sample_time(EPOCH, 3, np.float64(1e6)) == EPOCH + 3_000


# ---- ledger ------------------------------------------------------------------------------------


@given(st.lists(st.integers(1, 50), min_size=1, max_size=30))
def test_contiguous_blocks_lose_nothing(counts: list[int]) -> None:
    ledger, first = StreamLedger("rod/velocity"), 0
    for sequence, count in enumerate(counts):
        ledger.accept(a_block(first, count, sequence))
        first += count
    assert (ledger.received, ledger.lost) == (sum(counts), 0)
    assert (ledger.next_index, ledger.next_sequence) == (sum(counts), len(counts))
    assert (ledger.run_id, ledger.sample_rate) == ("run", 1e6)


@given(st.lists(st.booleans(), min_size=1, max_size=30))
def test_ledger_counts_exactly_what_is_dropped(dropped: list[bool]) -> None:
    """Whatever blocks are left out: every gap is reported once, at the block after it."""
    ledger, reported, size = StreamLedger("rod/velocity"), [], 7
    came = [i for i, is_dropped in enumerate(dropped) if not is_dropped]
    for i in came:
        try:
            ledger.accept(a_block(i * size, size, i))
        except SamplesLostError as error:
            reported.append((error.stream, error.found // size))
    last = came[-1] if came else -1
    assert reported == [("rod/velocity", i) for i in came if i > 0 and dropped[i - 1]]
    assert ledger.received == size * len(came)
    assert ledger.lost == size * sum(dropped[: last + 1])


def test_ledger_goes_on_after_a_gap() -> None:
    ledger = StreamLedger("rod/velocity")
    ledger.accept(a_block(0, 10, 0))
    with pytest.raises(SamplesLostError, match="rod/velocity: expected sample 10, got sample 30"):
        ledger.accept(a_block(30, 10, 3, flags=2))
    ledger.accept(a_block(40, 10, 4))
    assert (ledger.received, ledger.lost, ledger.flags) == (30, 20, 2)


def test_ledger_notices_a_block_that_comes_twice() -> None:
    ledger = StreamLedger("rod/velocity")
    ledger.accept(a_block(0, 10, 0))
    with pytest.raises(SamplesLostError):
        ledger.accept(a_block(0, 10, 0))
    assert (ledger.lost, ledger.next_index) == (0, 10)


def test_ledger_notices_a_wrong_sequence_number_alone() -> None:
    """A writer that was restarted goes on with the right index, but counts anew."""
    ledger = StreamLedger("rod/velocity")
    ledger.accept(a_block(0, 10, 0))
    with pytest.raises(SamplesLostError):
        ledger.accept(a_block(10, 10, 0))


def test_first_block_must_begin_the_run() -> None:
    with pytest.raises(SamplesLostError, match="expected sample 0, got sample 10"):
        StreamLedger("rod/velocity").accept(a_block(10, 10, 1))


def test_ledger_collects_flags() -> None:
    ledger = StreamLedger("rod/velocity")
    ledger.accept(a_block(0, 10, 0, flags=1))
    ledger.accept(a_block(10, 10, 1, flags=4))
    assert ledger.flags == 5


def test_ledger_refuses_another_run_and_another_rate() -> None:
    ledger = StreamLedger("rod/velocity", "run", sample_rate=1e6)
    with pytest.raises(BadInputError, match="rod/velocity: belongs to another run, got 'other'"):
        ledger.accept(a_block(run_id="other"))
    with pytest.raises(BadInputError, match="has another sample rate"):
        ledger.accept(a_block(sample_rate=5e5))
    assert (ledger.received, ledger.next_index) == (0, 0), "it counts for nothing"
    ledger.accept(a_block())


def test_derived_block_has_the_place_of_its_source() -> None:
    source = a_block(20, 10, 2, flags=7)
    made = source.derive("slider/velocity", "m/s", np.ones(10), np.int64(4))
    assert (made.first_index, made.sequence, made.time) == (20, 2, EPOCH)
    assert (made.end_index, made.flags, made.stream) == (30, 4, "slider/velocity")
    assert type(made.flags) is int, "NumPy integers do not go into messages"
