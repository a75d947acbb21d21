"""Words, blocks, rates and records of the driver; messages of the virtual instruments."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imotor_ros.core.drive import DriveProgram, DriveSegment
from imotor_ros.errors import BadInputError, InstrumentError
from imotor_ros.nodes.scpi.generator import check_program
from imotor_ros.nodes.scpi.instrument import Instrument
from imotor_ros.nodes.scpi.link import LinkError
from imotor_ros.nodes.scpi.oscilloscope import Record
from imotor_ros.nodes.scpi.rates import RatePlan, interpolation_error, plan_rate
from imotor_ros.nodes.scpi.settings import GeneratorSettings
from imotor_ros.nodes.scpi.words import WordFormat, block_of
from imotor_ros.nodes.virtual_instruments.syntax import Instrument as VirtualInstrument
from imotor_ros.nodes.virtual_instruments.syntax import MessageReader, Unit


@pytest.mark.parametrize(
    ("words", "largest"),
    [
        (WordFormat("int16", "little", 0, 32767), 32767),
        (WordFormat("uint16", "big", 8191, 8191), 8191),
        (WordFormat("uint8", "little", 128, 127), 127),
    ],
)
def test_samples_survive_as_words_within_half_a_step(words: WordFormat, largest: int) -> None:
    samples = np.sin(np.linspace(0.0, 20.0, 999))
    samples[:3] = 0.0, 1.0, -1.0
    back = (words.decode(words.encode(samples)) - words.zero) / largest
    assert np.max(np.abs(back - samples)) <= 0.5 / largest * (1 + 1e-9)
    assert tuple(back[:3]) == (0.0, 1.0, -1.0)  # rest and ends are exact


def test_words_at_the_ends_of_a_converter_are_found_by_its_bits() -> None:
    words = WordFormat("int16")
    codes = np.array([-2048, -2047, 0, 2046, 2047]) * 16.0
    assert words.at_ends(codes, 12).tolist() == [True, False, False, False, True]
    assert WordFormat("uint16").at_ends(np.array([0.0, 65280.0, 65024.0]), 8).tolist() == [
        True, True, False,
    ]  # fmt: skip


@given(st.binary(max_size=300), st.lists(st.integers(1, 40), min_size=1, max_size=30))
def test_blocks_come_through_whole_however_they_are_cut(payload: bytes, cuts: list[int]) -> None:
    """Ends of lines and marks of blocks may be among the bytes."""
    stream = b"*CLS\nDATA:DAC name," + block_of(payload) + b"\n*OPC?\n"
    reader, messages = MessageReader(), []
    while stream:
        count = cuts[len(messages) % len(cuts)]
        piece, stream = stream[:count], stream[count:]
        messages += list(reader.feed(piece))
    assert messages == [("*CLS", None), ("DATA:DAC name", payload), ("*OPC?", None)]


class Echo(VirtualInstrument):
    """Knows one command, in long and short form, with a number."""

    def commands(self) -> dict:
        return {"SOURce#:FUNCtion:ARBitrary": lambda unit: f"{unit.suffixes[0]} {unit.parameters}"}


def test_virtual_instruments_know_long_and_short_forms_only() -> None:
    echo = Echo("ECHO")
    for header in ("SOUR2:FUNC:ARB x", ":source2:function:arbitrary x", "SOURCE2:FUNC:ARB x"):
        assert echo.execute(header, None) == ["2 ('x',)"]
    assert echo.execute("SOUR:FUNC:ARB x", None) == ["1 ('x',)"]
    assert echo.execute("SOURC2:FUNC:ARB x", None) == []
    assert echo.execute("SYST:ERR?", None) == ['-113,"Undefined header; SOURC2:FUNC:ARB"']
    assert echo.execute("SYST:ERR?;*OPC?", None) == ['+0,"No error"', "1"]
    assert Unit("X", (), ("ON",)).switch()


PLAN = {
    "length": 100_000, "sample_rate": 1e6, "delay": 0.0, "memory": 10**6,
    "highest_frequency": 50e3, "tolerance": 1e-4, "where": "oscilloscope 1",
}  # fmt: skip


@pytest.mark.parametrize(
    ("rates", "memory", "chosen"),
    [
        ((2.5e5, 1e6, 2.5e6), 10**6, 1e6),  # the program's
        ((2.5e5, 1.25e6, 2.5e6), 10**6, 1.25e6),  # the lowest above
        ((2.5e5, 5e5, 1e6), 60_000, 5e5),  # the highest that the memory lets
    ],
)
def test_rate_is_that_of_the_program_or_the_nearest(rates, memory: int, chosen: float) -> None:
    plan = plan_rate(**{**PLAN, "rates": rates, "memory": memory})
    assert plan.rate == chosen
    assert plan.points <= memory
    assert plan.error_bound <= 1e-4


def test_rates_that_do_not_do_are_refused_with_the_numbers() -> None:
    with pytest.raises(BadInputError, match=r"got 10000, expected >= \d+ samples, at its lowest"):
        plan_rate(**{**PLAN, "rates": (2.5e5, 1e6), "memory": 10_000})
    with pytest.raises(BadInputError, match=r"rate of 250000 Hz .* wrong by, got 4.8e-05"):
        plan_rate(**{**PLAN, "rates": (2.5e5, 1e6), "memory": 30_000, "tolerance": 1e-6})


@pytest.mark.parametrize(("frequency", "rate"), [(50e3, 250e3), (50e3, 400e3), (200e3, 1e6)])
def test_error_bound_is_that_of_the_worst_sine(frequency: float, rate: float) -> None:
    """Sines of all phases, read at all fractions of an interval."""
    bound = interpolation_error(frequency, rate)
    worst = 0.0
    for phase in np.linspace(0.0, np.pi, 16):
        samples = np.sin(2 * np.pi * frequency / rate * np.arange(200) + phase)
        record = Record(samples, np.zeros(200, bool), 0.0, 1.0 / rate)
        step = 1.03 / rate
        values, _ = record.read(20.0 / rate, step, 130)
        times = 20.0 / rate + np.arange(130) * step
        worst = max(worst, np.max(np.abs(values - np.sin(2 * np.pi * frequency * times + phase))))
    assert 0.9 * bound < worst <= 1.01 * bound


def test_record_reads_whole_samples_as_they_are_and_says_what_it_covers() -> None:
    volts = np.arange(100.0) ** 2
    record = Record(volts, volts > 8000.0, -20e-6, 1e-6)
    values, limited = record.read(0.0, 1e-6, 71)
    assert values.tolist() == volts[20:91].tolist()
    assert limited.tolist() == (volts[20:91] > 8000.0).tolist()
    assert record.covers(0.0, 71e-6)
    assert not record.covers(0.0, 72e-6)
    assert not record.covers(-14e-6, 0.0)


def a_program(length: int, end: float = 0.0, rate: float = 1e6) -> DriveProgram:
    """Return a ramp to a voltage."""
    segment = DriveSegment("hold", length, 0.0, 0.0, 0.0, end)
    return DriveProgram("run", 0, rate, 1000.0, (segment,))


def test_programs_beyond_the_generator_are_refused() -> None:
    settings = GeneratorSettings(memory=1000, highest_rate=2e6)
    check_program(a_program(999), settings)
    with pytest.raises(BadInputError, match=r"got 1000, expected <= 999 samples \(0.000999 s"):
        check_program(a_program(1000), settings)
    with pytest.raises(BadInputError, match=r"sample_rate: .* got 4000000.0, expected 1 to 2e"):
        check_program(a_program(10, rate=4e6), settings)
    with pytest.raises(BadInputError, match=r"ends with a voltage.* got 5.0, expected 0 V"):
        check_program(a_program(10, end=5.0), settings)


class FakeLink:
    """Answers from a list; notes what was written."""

    def __init__(self, *answers: bytes) -> None:
        self.answers = b"".join(answers)
        self.written: list[bytes] = []

    def write(self, line: bytes) -> None:
        self.written.append(line)

    def read_line(self) -> str:
        if not self.answers:
            raise LinkError("no answer within 1 s")
        line, _, self.answers = self.answers.partition(b"\n")
        return line.decode()

    def read_exactly(self, count: int) -> bytes:
        data, self.answers = self.answers[:count], self.answers[count:]
        return data

    def close(self) -> None:
        self.written.append(b"closed")


class FakeDialect:
    """The least that an instrument needs."""

    family, identity, error_query, no_error = "ACME", "ACME,", "SYST:ERR?", r"\+?0,"


def an_instrument(*answers: bytes) -> Instrument:
    """Return an instrument that says who it is and then gives these answers."""
    link = FakeLink(b"ACME,T1,42,1.0\n", *answers)
    return Instrument("generator", "ADDRESS", "42", FakeDialect(), lambda *_: link, (1.0, 1.0))


def test_instrument_reads_blocks_and_empties_its_error_queue() -> None:
    tool = an_instrument(block_of(b"a\nb") + b"\n", b'-1,"one"\n-2,"two"\n+0,"none"\n')
    assert tool.identity == "ACME T1 42"
    assert tool.ask_block("DATA?") == b"a\nb"
    with pytest.raises(InstrumentError) as caught:
        tool.check_errors("VOLT 3")
    assert str(caught.value) == ('generator at ADDRESS: VOLT 3: error queue: -1,"one"; -2,"two"')


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (b"1.5\n", "DATA?: answered b'1.'..., expected a block #<n><length>"),
        (b"#2x4", "DATA?: a block has the length b'x4'"),
    ],
)
def test_answer_that_is_no_block_is_told(answer: bytes, text: str) -> None:
    with pytest.raises(InstrumentError) as caught:
        an_instrument(answer).ask_block("DATA?")
    assert text in str(caught.value)


def test_answer_that_is_no_number_or_does_not_come_is_told() -> None:
    with pytest.raises(InstrumentError, match=r"FREQ\?: answered 'fast', expected a number"):
        an_instrument(b"fast\n").ask_number("FREQ?")
    with pytest.raises(InstrumentError, match=r"ADDRESS: FREQ\?: no answer within 1 s"):
        an_instrument().ask("FREQ?")


def test_rate_plan_keeps_room_for_a_delay() -> None:
    early = plan_rate(**{**PLAN, "rates": (1e6,), "delay": -1e-3})
    late = plan_rate(**{**PLAN, "rates": (1e6,), "delay": 1e-3})
    assert isinstance(early, RatePlan)
    assert early.before - late.before == 1000
