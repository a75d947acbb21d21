"""The driver of a bench of instruments over topics; the instruments are a process of their own."""

from __future__ import annotations

import socket
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from imotor_ros.campaign.leaves import flatten
from imotor_ros.campaign.roles.generator import GeneratorRole
from imotor_ros.contracts.blocks import StreamLedger
from imotor_ros.contracts.messages import block_from_message, channel_from_message
from imotor_ros.contracts.topics import (
    CHANNELS,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    MEASURED_TOPICS,
)
from imotor_ros.core.alignment import compensate_delay
from imotor_ros.core.channel import SampleFlag
from imotor_ros.core.drive import DriveProgram, Ending, steady_drive
from imotor_ros.nodes.scpi_bench import ScpiBenchNode

MONITOR = "drive/voltage_monitor"


def a_program(run_id: str = "run", hold_time: float = 5e-3) -> DriveProgram:
    """Return a run of some thousand samples."""
    return steady_drive(
        run_id=run_id, epoch=10**18, sample_rate=1e6, fundamental_frequency=4625.0, offset=50.0,
        amplitudes=(36.0, 12.0), phases=(0.0, -2.7), hold_time=hold_time, bias_time=2e-3,
    )  # fmt: skip


class Bench:
    """The driver, and its peers."""

    def __init__(self, graph: Any, settings: dict[str, Any], **changes: Any) -> None:
        self.graph = graph
        graph.write(DRIVE_PROGRAM, DRIVE_VOLTAGE)
        self.progress = graph.hear(DRIVE_PROGRESS)
        self.heard = {topic.name: graph.hear(topic) for topic in MEASURED_TOPICS}
        self.channels = graph.hear(CHANNELS)
        leaves = {**dict(flatten(settings, "settings")), **changes}
        self.node = graph.add(ScpiBenchNode, **{"block_length": 5000, **leaves})

    def start(self) -> Bench:
        """Configure and activate the driver."""
        self.graph.start(self.node)
        return self

    def play(self, program: DriveProgram, until: int | None = None) -> None:
        """Announce a program and send its voltage, or the start of it, as the generator does."""
        self.graph.announce(program)
        role = GeneratorRole(program, 1000, 30)
        end = program.length if until is None else until
        while role.sent < end and not self.faults():
            block = role.next_block()
            if block is not None:
                self.graph.send_block(block)
                continue
            self.graph.spin_until(
                lambda: self.consumed(program) > role.consumed or self.faults(),
                lambda: f"more than {role.consumed} samples to be acknowledged",
            )
            role.acknowledge(self.consumed(program))

    def finish(self, program: DriveProgram) -> None:
        """Wait until everything is acknowledged and measured."""

        def come() -> list[int]:
            ends = [self.end(name, program) for name in self.heard]
            return [self.consumed(program), *ends]

        self.graph.spin_until(
            lambda: min(come()) >= program.length,
            lambda: f"{program.length} samples; {come()} came, faults {self.faults()}",
        )

    def faults(self) -> list[str]:
        """Return the faults told on drive/progress."""
        return [message.fault for message in self.progress if message.fault]

    def consumed(self, program: DriveProgram) -> int:
        """Return how many samples of a run are acknowledged."""
        own = [m.consumed for m in self.progress if m.run_id == program.run_id]
        return max(own, default=0)

    def blocks(self, name: str, program: DriveProgram) -> list[Any]:
        """Return the blocks of a stream."""
        blocks = [block_from_message(message) for message in self.heard[name]]
        return [block for block in blocks if block.run_id == program.run_id]

    def end(self, name: str, program: DriveProgram) -> int:
        """Return where a stream has come to; its blocks follow each other."""
        ledger = StreamLedger(name, program.run_id, sample_rate=program.sample_rate)
        for block in self.blocks(name, program):
            ledger.accept(block)
        return ledger.next_index

    def samples(self, name: str, program: DriveProgram) -> np.ndarray:
        """Return the samples of a stream."""
        return np.concatenate([block.samples for block in self.blocks(name, program)])

    def flags(self, name: str, program: DriveProgram) -> int:
        """Return all flags of a stream."""
        return int(np.bitwise_or.reduce([one.flags for one in self.blocks(name, program)]))

    def await_fault(self, *texts: str) -> str:
        """Wait for a fault on drive/progress with texts in it; return it."""
        self.graph.spin_until(self.faults, f"a fault with {texts}")
        fault = self.faults()[0]
        for text in texts:
            assert text in fault
        assert len(self.faults()) == 1
        assert "\n" not in fault
        return fault


def await_off(graph: Any, laboratory: Any, seconds: float = 5.0) -> None:
    """Wait until the generator's output is off: it may be told before it has read so."""
    graph.spin_until(lambda: not laboratory.tell("state")["is_on"], "the output to be off", seconds)


def check_monitor(bench: Bench, program: DriveProgram, voltage: np.ndarray) -> None:
    """The monitor shows the voltage within the uncertainty of its description."""
    described = {channel_from_message(m).name: channel_from_message(m) for m in bench.channels}
    channel = described[MONITOR]
    shown = compensate_delay(bench.samples(MONITOR, program), channel.delay, program.sample_rate)
    inner = slice(50, -50)
    gain, zero = np.polyfit(voltage[inner], shown[inner], 1)
    assert gain == pytest.approx(1.0, abs=3.0 * channel.gain_uncertainty + 0.005)  # and low-pass
    assert zero == pytest.approx(0.0, abs=1.0)
    left = shown[inner] - gain * voltage[inner] - zero
    assert np.std(left) < 2.0  # low-pass of amplifier and monitor at the second harmonic


def test_program_is_collected_played_and_measured(graph: Any, laboratory: Any) -> None:
    bench, program = Bench(graph, laboratory.settings()).start(), a_program()
    before = laboratory.tell("state")["runs"]
    bench.play(program)
    bench.finish(program)
    check_monitor(bench, program, program.render(0, program.length))
    assert laboratory.tell("state") == pytest.approx(
        {"is_on": False, "runs": before + 1, "peak": np.max(program.render(0, program.length))},
        rel=1e-3,
    )
    consumed = [message.consumed for message in bench.progress]
    assert consumed == sorted(consumed)
    assert consumed[-2] == program.length - 1  # until all is published the run is the generator's
    names = {channel_from_message(message).name for message in bench.channels}
    assert names == {topic.name for topic in MEASURED_TOPICS}
    one = next(m for m in map(channel_from_message, bench.channels) if m.name == MONITOR)
    assert one.resolution == pytest.approx(2 * 6.0 * 20.0 / 2**12)
    assert "TEKTRONIX MSO58" in one.instrument


def test_other_dialects_with_two_oscilloscopes_of_8_bit(graph: Any, four_inputs_twice: Any) -> None:
    """They have no rate of 1 MHz: the records are read between their samples."""
    bench, program = Bench(graph, four_inputs_twice.settings()).start(), a_program()
    bench.play(program)
    bench.finish(program)
    check_monitor(bench, program, program.render(0, program.length))
    described = {m.name: m for m in map(channel_from_message, bench.channels)}
    assert described["rod/velocity"].resolution == pytest.approx(2 * 6.0 * 0.125 / 2**8)


def test_runs_follow_each_other(graph: Any, laboratory: Any) -> None:
    bench = Bench(graph, laboratory.settings()).start()
    for run_id in ("first", "second"):
        program = a_program(run_id, 1e-3)
        bench.play(program)
        bench.finish(program)
    assert bench.faults() == []


def test_stop_while_it_plays_brings_the_voltage_to_zero(graph: Any, laboratory: Any) -> None:
    changes = {"voltage_timeout": 10.0, "block_length": 50_000}
    bench, program = Bench(graph, laboratory.settings(), **changes), a_program(hold_time=0.4)
    bench.start()
    bench.play(program)
    graph.spin_until(
        lambda: bench.node.is_voltage_on,
        lambda: f"the voltage to be on; {bench.node.status_values()} {bench.faults()}",
    )
    graph.spin(0.1)
    graph.announce(replace(program, ending=Ending.STOPPED))
    graph.spin_until(lambda: not bench.node.is_voltage_on, "the voltage to be off", 0.5)
    await_off(graph, laboratory)
    bench.finish(program)
    shown = bench.samples(MONITOR, program)
    on = np.flatnonzero(np.abs(shown) > 5.0)
    assert 0.08e6 < on[-1] < 0.3e6  # played until the stop, and then not to its end
    assert np.max(np.abs(np.diff(shown[on[-1] - 40_000 :]))) < 8.0  # no jump: a ramp
    flagged = [b for b in bench.blocks(MONITOR, program) if b.flags & SampleFlag.RAMPED_DOWN]
    assert flagged[0].first_index < on[-1]
    assert flagged[-1].end_index == program.length


def test_stop_before_it_plays_measures_without_voltage(graph: Any, laboratory: Any) -> None:
    bench, program = Bench(graph, laboratory.settings()).start(), a_program()
    bench.play(program, until=4000)
    graph.spin_until(lambda: bench.consumed(program) >= 4000, "4000 samples collected")
    stopped = replace(program.stopped_at(4000, 500, 500), ending=Ending.STOPPED)
    graph.announce(stopped)
    role = GeneratorRole(stopped, 1000, 10**6)
    for block in iter(role.next_block, None):
        if block.first_index >= 4000:
            graph.send_block(block)
    bench.finish(stopped)
    assert np.max(np.abs(bench.samples(MONITOR, program))) < 0.5
    assert bench.flags(MONITOR, program) & SampleFlag.RAMPED_DOWN


@pytest.mark.parametrize(
    ("fault", "texts"),
    [
        ("generator error_after_upload", ("DATA:ARB:DAC", "-780", "Not able to load")),
        ("oscilloscope_1 no_trigger", ("oscilloscope 1", "ACQ:STATE?", "was there a trigger")),
        ("oscilloscope_1 cut_record", ("oscilloscope 1", "CURV?", "cut after")),
        ("oscilloscope_1 short_record", ("CURV?", "bytes came, expected")),
        ("oscilloscope_1 slow 3.0", ("oscilloscope 1", "no answer within 2 s")),
        ("generator slow 3.0", ("generator", "SYST:ERR?", "no answer within 2 s")),
    ],
)
def test_fault_of_an_instrument_ends_the_run_with_its_name(
    graph: Any, laboratory: Any, fault: str, texts: tuple[str, ...]
) -> None:
    changes = {"voltage_timeout": 10.0}  # here is no generator that tells that it lives
    bench, program = Bench(graph, laboratory.settings(), **changes), a_program(hold_time=1e-3)
    bench.start()
    laboratory.tell(f"fault {fault}")
    bench.play(program)
    message = bench.await_fault(*texts)
    assert "127.0.0.1" in message
    await_off(graph, laboratory)
    assert bench.consumed(program) < program.length
    laboratory.tell("clear")
    assert bench.node.trigger_deactivate() is not None
    graph.start_again(bench.node)
    bench.progress.clear()
    again = a_program("again", 1e-3)
    bench.play(again)
    bench.finish(again)


def test_wrong_instrument_is_refused(graph: Any, laboratory: Any) -> None:
    bench = Bench(graph, laboratory.settings())
    laboratory.tell("fault generator identity")
    bench.node.trigger_configure()
    bench.node.trigger_activate()
    fault = "*IDN?: answered 'NOBODY,NOTHING,0,0', expected a Keysight 33500B/33600A"
    assert fault in bench.node.fault


def test_instrument_that_is_not_there_is_named(graph: Any, laboratory: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address = f"TCPIP0::127.0.0.1::{port}::SOCKET"
    bench = Bench(graph, laboratory.settings(), **{"oscilloscope_1.address": address})
    bench.node.trigger_configure()
    bench.node.trigger_activate()
    wanted = f"cannot activate: oscilloscope 1 at {address}: no connection: Connection refused"
    assert bench.node.fault == wanted


def test_wrong_serial_number_is_refused(graph: Any, laboratory: Any) -> None:
    bench = Bench(graph, laboratory.settings(), **{"generator.serial": "MY1"})
    bench.node.trigger_configure()
    bench.node.trigger_activate()
    assert "has the serial number 'VIRTUAL0001', expected 'MY1'" in bench.node.fault


def test_program_beyond_the_memory_is_refused(graph: Any, laboratory: Any) -> None:
    bench = Bench(graph, laboratory.settings(), **{"generator.memory": 5000}).start()
    bench.play(a_program())
    bench.await_fault("longer than the generator's memory", "got 9432", "<= 4999 samples")


def test_record_beyond_the_memory_is_refused(graph: Any, laboratory: Any) -> None:
    bench = Bench(graph, laboratory.settings(), **{"oscilloscope_1.memory": 500}).start()
    bench.play(a_program())
    bench.await_fault("oscilloscope 1: memory", "the run of 9432 samples", "got 500")


@pytest.mark.parametrize("wrong", [130.0, float("nan")])
def test_voltage_out_of_range_is_refused(graph: Any, laboratory: Any, wrong: float) -> None:
    bench, program = Bench(graph, laboratory.settings()).start(), a_program()
    before = laboratory.tell("state")["runs"]
    graph.announce(program)
    block = GeneratorRole(program, 1000, 10).next_block()
    assert block is not None
    voltage = block.samples.copy()
    voltage[7] = wrong
    graph.send_block(replace(block, samples=voltage))
    bench.await_fault("drive/voltage: sample 7", f"got {wrong}", "-20 to 120 V")
    assert laboratory.tell("state")["runs"] == before


def test_input_that_is_over_range_is_flagged(graph: Any, laboratory: Any) -> None:
    changes = {"voltage_monitor.input_range": 2.0}
    bench, program = Bench(graph, laboratory.settings(), **changes).start(), a_program()
    bench.play(program)
    bench.finish(program)
    assert bench.flags(MONITOR, program) & SampleFlag.OVER_RANGE
    assert not bench.flags("rod/velocity", program) & SampleFlag.OVER_RANGE


def test_deactivation_while_it_plays_leaves_no_voltage_on(graph: Any, laboratory: Any) -> None:
    bench, program = Bench(graph, laboratory.settings()).start(), a_program(hold_time=0.5)
    bench.play(program)
    graph.spin_until(lambda: bench.node.is_voltage_on, "the voltage to be on")
    bench.node.trigger_deactivate()
    await_off(graph, laboratory)


def test_silent_generator_leaves_no_voltage_on(graph: Any, laboratory: Any) -> None:
    bench, program = Bench(graph, laboratory.settings(), voltage_timeout=0.2), a_program("s", 0.8)
    bench.start()
    bench.play(program)
    bench.await_fault("no voltage has come for")
    await_off(graph, laboratory)


def test_abandoned_run_leaves_no_voltage_on(graph: Any, laboratory: Any) -> None:
    bench, program = Bench(graph, laboratory.settings()).start(), a_program(hold_time=0.5)
    bench.play(program)
    graph.spin_until(lambda: bench.node.is_voltage_on, "the voltage to be on")
    graph.announce(replace(program, ending=Ending.ABANDONED))
    bench.await_fault("abandoned by the signal generator")
    await_off(graph, laboratory)


def test_bench_that_is_not_set_up_is_refused(graph: Any) -> None:
    node = graph.add(ScpiBenchNode)
    node.trigger_configure()
    assert "oscilloscope_1.address: is not set" in node.fault
