"""The check of a driver: what is done to it, one scenario after another, over topics only."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from lifecycle_msgs.msg import Transition
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from imotor_ros.campaign.conformance.flow_checks import (
    check_acknowledged_when_put_out,
    check_flow,
    collects_first,
)
from imotor_ros.campaign.conformance.programs import (
    CheckParameters,
    ProgramBuilder,
    characterising_program,
    short_program,
)
from imotor_ros.campaign.conformance.record import MEASURED, RunRecord
from imotor_ros.campaign.conformance.requirements import Findings, Verdict
from imotor_ros.campaign.conformance.signal_checks import (
    RunSignals,
    check_alignment,
    check_clock,
    check_identity,
    check_voltage,
)
from imotor_ros.campaign.conformance.stop_checks import (
    clipping_defects,
    fault_defects,
    is_at_zero,
    last_voltage,
    ramp_defects,
)
from imotor_ros.campaign.conformance.stream_checks import check_channels, check_streams
from imotor_ros.contracts.topics import (
    CHANNELS,
    DRIVE_PROGRAM,
    DRIVE_PROGRESS,
    DRIVE_VOLTAGE,
    PERFORMANCE,
    RECORDING,
    RUN_INFO,
    STATE,
    Intent,
    Topic,
    topic_named,
)
from imotor_ros.core.drive import DriveProgram, Ending
from imotor_ros.errors import DeadlineError, NodeDiedError
from imotor_ros.nodes.driver_nodes import DriverProcesses
from imotor_ros.nodes.driver_probe import DriverProbe
from imotor_ros.nodes.stand_client import (
    ACTIVATE,
    CLEAN_UP,
    CONFIGURE,
    DEACTIVATE,
    TRANSITION_NAMES,
)

SHUTDOWN = Transition.TRANSITION_UNCONFIGURED_SHUTDOWN

_TARGETS = {
    CONFIGURE: "inactive",
    CLEAN_UP: "unconfigured",
    ACTIVATE: "active",
    DEACTIVATE: "inactive",
}

_FOREIGN = (DRIVE_VOLTAGE, DRIVE_PROGRAM, STATE, RUN_INFO, PERFORMANCE, RECORDING)
"""What generator, evaluator and recorder publish, and a driver does not."""

_PATIENCE = "match_timeout"
"""Parameter of the nodes of this stand that says how long they wait for their peers."""

_DIAGNOSTICS_TIME = 2.5
"""Longest wait (s) for diagnostics, which come once a second and on change."""

_LIVES = 2
"""Starts of the driver that all scenarios need: one life ends by a signal, one by a transition."""

REPLAY_REASON = "it plays a recorded run and takes no voltage"


@dataclass(frozen=True)
class Deadlines:
    """
    Longest waits (s).

    Attributes
    ----------
    start : float
        For the nodes to come up.
    transition : float
        For the answer to a transition.
    discovery : float
        For endpoints to be found.
    stall : float
        For the next acknowledgement or block.
    end : float
        For the processes to end.

    """

    start: float = 60.0
    transition: float = 30.0
    discovery: float = 5.0
    stall: float = 5.0
    end: float = 10.0


class CheckAborted(Exception):
    """The driver is in no state in which the check can go on; the text says why."""


@dataclass(frozen=True)
class Stage:
    """
    A part of the check.

    Attributes
    ----------
    text : str
        What is being done.
    requirement : str
        Id of the requirement that fails if the driver ends or hangs meanwhile.
    scenario : callable
        Does it.

    """

    text: str
    requirement: str
    scenario: Callable[[], None]


class DriverCheck:
    """
    Checks one driver.

    Parameters
    ----------
    probe : DriverProbe
        Plays the driver's peers.
    nodes : sequence of str
        Names of the driver's nodes.
    parameters : CheckParameters
        What the check may do.
    streams : tuple of str
        The measured streams that the driver has to have.
    start : callable, optional
        Starts the driver's processes; without it the driver runs already, and is left running.
    deadlines : Deadlines
        Longest waits.
    lives : int
        How often it may be started: once leaves out the transition shutdown.

    """

    def __init__(
        self,
        probe: DriverProbe,
        nodes: Sequence[str],
        parameters: CheckParameters,
        *,
        streams: tuple[str, ...] = MEASURED,
        start: Callable[[], DriverProcesses] | None = None,
        deadlines: Deadlines | None = None,
        lives: int = _LIVES,
    ) -> None:
        self.findings = Findings()
        self.unreached = ""
        self._probe = probe
        self._nodes = list(nodes)
        self._parameters = parameters
        self._streams = streams
        self._start = start
        self._processes: DriverProcesses | None = None
        self._deadlines = deadlines or Deadlines()
        self._stage = Stage("start", "L1", _nothing)
        self._run_number = 0
        self._collects_first = False
        self._lives = lives

    # ---- order ---------------------------------------------------------------------------

    def run(self) -> Iterator[str]:
        """Carry out all scenarios, one after the other; yield what is being done."""
        try:
            for stage in self._stages():
                self._stage = stage
                yield stage.text
                stage.scenario()
        except (CheckAborted, NodeDiedError, DeadlineError) as error:
            self.unreached = str(error).partition("; its last lines:")[0].splitlines()[0]
            if not isinstance(error, CheckAborted):
                self.findings.fails(self._stage.requirement, f"{self._stage.text}: {error}")
        finally:
            self._probe.watch = _nothing
            if self._processes is not None:
                self._processes.stop(self._deadlines.end)

    def _stages(self) -> Iterator[Stage]:
        yield Stage("start", "L1", self._start_up)
        yield Stage("transitions out of place", "L3", self._refuse_in_unconfigured)
        yield Stage("configure", "L2", lambda: self._transit(CONFIGURE))
        yield Stage("transitions out of place", "L3", self._refuse_in_inactive)
        yield Stage("interfaces", "I1", self._check_interfaces)
        yield from self._replay_stages() if self._probe.is_replay else self._driver_stages()

    def _driver_stages(self) -> Iterator[Stage]:
        yield Stage("activate", "L2", lambda: self._transit(ACTIVATE))
        yield Stage("steps and sines", "F1", self._characterise)
        yield Stage("blocks of any length", "F4", self._play_in_pieces)
        yield Stage("slow reader", "F3", self._read_slowly)
        yield Stage("stop", "S2", self._stop_gently)
        yield Stage("another run too soon", "S8", self._interrupt_by_another)
        yield Stage("abandoned run", "S4", self._abandon)
        yield Stage("voltage out of range", "V2", self._exceed_range)
        yield Stage("voltage that is no number", "V3", self._send_nan)
        yield Stage("missing voltage", "S6", self._send_gap)
        yield Stage("silent generator", "S5", self._fall_silent)
        yield Stage("deactivation with voltage on", "S7", self._deactivate_under_voltage)
        yield Stage("missing reader", "F5", self._miss_a_reader)
        yield Stage("clean-up and return", "L2", self._return_from_unconfigured)
        yield Stage("end with voltage on", "S7", self._end_under_voltage)
        yield Stage("shutdown", "L4", self._shut_down)

    def _replay_stages(self) -> Iterator[Stage]:
        self.findings.skips("I4 L5 F4 V2 V3 S1 S2 S3 S4 S5 S6 S7 S8 S9", REPLAY_REASON)
        yield Stage("replay", "D1", self._replay)
        yield Stage("replay again", "L6", self._replay_again)
        yield Stage("missing reader", "F5", self._activate_without_reader)
        yield Stage("clean-up and return", "L2", self._return_unconfigured)
        yield Stage("shutdown", "L4", self._shut_down)

    # ---- replay --------------------------------------------------------------------------

    def _replay(self) -> None:
        self._transit(ACTIVATE)
        record = self._await_replay()
        self._await_descriptions(record)
        check_streams(record, self._streams, self.findings)
        check_flow(record, self.findings)
        self._check_signals(record)
        self._transit(DEACTIVATE)

    def _replay_again(self) -> None:
        self._probe.runs.clear()
        self._transit(ACTIVATE)
        time.sleep(0.5)  # a reader that does not read
        record = self._await_replay()
        findings = Findings()
        check_streams(record, self._streams, findings)
        check_flow(record, findings)
        self._adopt("L6", findings, f"{record.sent} samples again from index 0")
        self._adopt("F3", findings, f"{record.sent} samples read after 0.5 s")
        self._transit(DEACTIVATE)

    def _return_unconfigured(self) -> None:
        self._transit(CLEAN_UP)
        self._transit(CONFIGURE)
        self._transit(CLEAN_UP)

    # ---- processes and lifecycle ---------------------------------------------------------

    def _start_up(self) -> None:
        if self._start is not None:
            self._processes = self._start()
            self._probe.watch = self._processes.check
        absent = self._probe.await_managed(self._nodes, self._deadlines.start)
        if absent:
            text = f"{', '.join(absent)}: no lifecycle services within {self._deadlines.start:g} s"
            self.findings.fails("L1", text)
            raise CheckAborted(text)
        states = self._states()
        if self._start is None:
            self._bring_to_unconfigured(states)
            self.findings.passes("L1", f"found {_listed(states)}")
            return
        wrong = {node: state for node, state in states.items() if state != "unconfigured"}
        if wrong:
            self.findings.fails("L1", f"does not start unconfigured: {_listed(wrong)}")
            self._bring_to_unconfigured(states)
        else:
            self.findings.passes("L1", f"{_listed(states)} after start")

    def _bring_to_unconfigured(self, states: dict[str, str]) -> None:
        active = [node for node, state in states.items() if state == "active"]
        if active:
            self._probe.change(active, DEACTIVATE, self._deadlines.transition)
        inactive = [node for node, state in self._states().items() if state == "inactive"]
        if inactive:
            self._probe.change(inactive, CLEAN_UP, self._deadlines.transition)

    def _states(self) -> dict[str, str]:
        return self._probe.states(self._nodes, self._deadlines.transition)

    def _transit(self, transition: int) -> None:
        """Take all nodes through a transition; if one does not, nothing more can be checked."""
        began = time.monotonic()
        self._probe.change(self._nodes, transition, self._deadlines.transition)
        wanted = _TARGETS[transition]
        wrong = {node: state for node, state in self._states().items() if state != wanted}
        what = TRANSITION_NAMES[transition]
        if wrong:
            text = f"did not {what}: {_listed(wrong)}; {self._reason_of(wrong)}"
            self.findings.fails("L2", text)
            raise CheckAborted(text)
        self.findings.passes("L2", f"{what} in {time.monotonic() - began:.1f} s")

    def _reason_of(self, nodes: Iterable[str]) -> str:
        """Return what nodes that did not take a transition say in /diagnostics."""
        names = list(nodes)

        def told() -> list[str]:
            status = self._probe.status_of(names)
            return [" ".join(text.split()) for is_error, text in status if is_error and text]

        self._probe.waits_for(told, _DIAGNOSTICS_TIME)
        found = told()
        return f"/diagnostics: {'; '.join(found)}" if found else "no error in /diagnostics"

    def _refuse_in_unconfigured(self) -> None:
        self._expect_refusal(ACTIVATE, "unconfigured")

    def _refuse_in_inactive(self) -> None:
        self._expect_refusal(CONFIGURE, "inactive")

    def _expect_refusal(self, transition: int, state: str) -> None:
        answers = self._probe.change(self._nodes, transition, self._deadlines.transition)
        states = self._states()
        done = [node for node, is_done in answers.items() if is_done or states[node] != state]
        text = f"{TRANSITION_NAMES[transition]} while {state}"
        defects = [f"{node} accepts to {text}" for node in done]
        self.findings.judge("L3", defects, f"refuses to {text}, and stays")

    def _reactivate(self, requirement: str = "") -> None:
        """Clear a fault, as an operator does."""
        try:
            self._transit(DEACTIVATE)
            self._transit(ACTIVATE)
        except CheckAborted as error:
            if requirement:
                self.findings.fails(requirement, str(error))
            raise

    # ---- interfaces ----------------------------------------------------------------------

    def _check_interfaces(self) -> None:
        probe = self._probe
        writers = [*map(topic_named, self._streams), DRIVE_PROGRESS, CHANNELS]
        readers = [DRIVE_VOLTAGE, DRIVE_PROGRAM]
        probe.waits_for(
            lambda: (
                all(self._endpoints(t, is_writer=True) for t in writers)
                and (
                    all(self._endpoints(t, is_writer=False) for t in readers)
                    or self._endpoints(DRIVE_VOLTAGE, is_writer=True)
                )
            ),
            self._deadlines.discovery,
        )
        is_player = bool(self._endpoints(DRIVE_VOLTAGE, is_writer=True)) and not self._endpoints(
            DRIVE_VOLTAGE, is_writer=False
        )
        if is_player:
            probe.give_way_to_player()
            readers, writers = [], [*writers, DRIVE_VOLTAGE, DRIVE_PROGRAM, RUN_INFO]
        types, qualities, counts = [], [], []
        for topic, is_writer in [(t, True) for t in writers] + [(t, False) for t in readers]:
            found = self._endpoints(topic, is_writer=is_writer)
            verb = "publishes" if is_writer else "reads"
            if not found:
                types.append(f"no node {verb} {topic.name}")
            for info in found:
                types += _type_defects(topic, info, verb, self._type_hash(topic))
                qualities += _quality_defects(topic, info, verb)
            if is_writer and topic is not CHANNELS and len(found) > 1:
                nodes = ", ".join(info.node_name for info in found)
                counts.append(f"{topic.name} has {len(found)} writers: {nodes}")
        counts += [
            f"publishes {topic.name}, which others write"
            for topic in _FOREIGN
            if topic not in writers and self._endpoints(topic, is_writer=True)
        ]
        number = f"{len(writers)} topics written, {len(readers)} read"
        self.findings.judge("I1", types, number)
        self.findings.judge("I2", qualities, f"{number}; keep-all shows only under load (F3)")
        self.findings.judge("I3", counts, f"{len(writers)} topics")
        if types:
            raise CheckAborted(f"topics are missing: {types[0]}")

    def _endpoints(self, topic: Topic, *, is_writer: bool) -> list[Any]:
        node = self._probe.node
        name = topic.name if topic.name.startswith("/") else f"{self._probe.namespace}/{topic.name}"
        ask = (
            node.get_publishers_info_by_topic if is_writer else node.get_subscriptions_info_by_topic
        )
        return [
            info for info in ask(name)
            if info.node_name in self._nodes and info.node_namespace == self._probe.namespace
        ]  # fmt: skip

    def _type_hash(self, topic: Topic) -> str:
        """Return the hash of our own definition of a topic's type, by our own endpoint."""
        node, name = self._probe.node, f"{self._probe.namespace}/{topic.name}"
        own = [
            *node.get_publishers_info_by_topic(name),
            *node.get_subscriptions_info_by_topic(name),
        ]
        return next(
            (str(info.topic_type_hash) for info in own if info.node_name == node.get_name()), ""
        )

    # ---- runs ----------------------------------------------------------------------------

    def _next_id(self, what: str) -> str:
        self._run_number += 1
        return f"check-{self._run_number}-{what}"

    def _play_all(self, program: DriveProgram, lengths: Sequence[int] = ()) -> RunRecord:
        """Play a program to its end and read all that comes of it."""
        record = self._probe.announce(program)
        stall = self._deadlines.stall
        self._probe.play(record, lengths=lengths, stall_timeout=stall)
        if not record.fault:
            self._probe.receives_all(record, self._streams, stall_timeout=stall)
        self._probe.close_run()
        return record

    def _play_until(self, program: DriveProgram, share: float = 0.5) -> RunRecord:
        """Play a part of a program, all of it acknowledged: the voltage is on then."""
        record = self._probe.announce(program)
        until = int(share * program.length)
        if not self._probe.play(record, until=until, stall_timeout=self._deadlines.stall):
            told = record.fault or f"{record.consumed} of {record.sent} samples acknowledged"
            raise CheckAborted(f"run {program.run_id} did not come to its middle: {told}")
        return record

    def _settle(self, record: RunRecord, timeout: float = 3.0) -> None:
        self._probe.settle(record, 0.3, timeout)

    def _characterise(self) -> None:
        record = self._play_all(characterising_program(self._parameters, self._next_id("sines")))
        self._await_descriptions(record)
        check_flow(record, self.findings)
        check_streams(record, self._streams, self.findings)
        if record.fault:
            self.findings.fails("F1", f"fault in an ordinary run: {record.fault}")
        if not record.is_complete(()):
            why = record.fault or "see F1"
            raise CheckAborted(f"the first run was not played to its end: {why}")
        self._collects_first = collects_first(record)
        check_acknowledged_when_put_out(record, self.findings)
        self._check_signals(record)

    def _await_descriptions(self, record: RunRecord) -> None:
        """Give latched facts the time that discovery takes: they may come after the samples."""
        self._probe.waits_for(
            lambda: all(stream in record.descriptions for stream in self._streams),
            self._deadlines.discovery,
        )

    def _check_signals(self, record: RunRecord) -> None:
        check_channels(record, self._streams, self.findings)
        if not record.is_complete(self._streams):
            self.findings.skips("V1 A1 A2 A3", "samples are missing")
            return
        signals = RunSignals(record)
        check_voltage(signals, self.findings)
        check_identity(signals, self.findings)
        check_alignment(signals, self._streams, self.findings, self._parameters.alignment_tolerance)
        check_clock(signals, self._streams, self.findings)

    def _play_in_pieces(self) -> None:
        """Another run in the same activation, in odd pieces."""
        rate = self._parameters.sample_rate
        longest = round(10e-3 * rate)
        findings = Findings()
        program = short_program(self._parameters, self._next_id("pieces"))
        record = self._play_all(program, lengths=(1, 7, longest, 777, 2))
        check_streams(record, self._streams, findings)
        check_flow(record, findings)
        self._adopt("L5", findings, f"run {program.run_id} from index 0 to {record.consumed}")
        self._adopt("F4", findings, f"{record.sent} samples in blocks of 1, 7, 777 and {longest}")

    def _read_slowly(self) -> None:
        findings = Findings()
        program = short_program(self._parameters, self._next_id("unread"))
        record = self._probe.announce(program)
        rate = self._parameters.sample_rate
        piece = max(1, round(0.05e-3 * rate))
        count = min(400, round(0.6 * 30e-3 * rate) // piece)
        for _ in range(count):
            self._probe.send(record, piece)
        time.sleep(0.5)  # a reader that does not read
        stall = self._deadlines.stall
        self._probe.play(record, lengths=(piece,), stall_timeout=stall)
        self._probe.receives_all(record, self._streams, stall_timeout=stall)
        self._probe.close_run()
        check_streams(record, self._streams, findings)
        check_flow(record, findings)
        blocks = sum(map(len, record.blocks.values()))
        self._adopt("F3", findings, f"{blocks} blocks of {piece} samples read after 0.5 s")

    def _adopt(self, requirement: str, findings: Findings, evidence: str) -> None:
        """
        Take over what the checks of a run found as the verdict on one requirement.

        What is wrong in every run has been said of the first one, under the requirement that it
        belongs to, and is not said again.
        """
        known = {one.requirement for one in self.findings if one.verdict is Verdict.FAIL}
        wrong = [one for one in findings if one.verdict is Verdict.FAIL]
        defects = [f"{one.requirement}: {one.evidence}" for one in wrong]
        new = [
            text for one, text in zip(wrong, defects, strict=True) if one.requirement not in known
        ]
        others = sorted({one.requirement for one in wrong} & known)
        but = f" (but for {', '.join(others)})" if others else ""
        self.findings.judge(requirement, new, f"{evidence}{but}")

    # ---- stops and faults ----------------------------------------------------------------

    def _under_voltage(self, what: str, hold_time: float = 40e-3) -> RunRecord:
        return self._play_until(short_program(self._parameters, self._next_id(what), hold_time))

    def _at_work(self, what: str) -> RunRecord:
        """Play a part of a program; all of it if the driver plays from a memory of its own."""
        record = self._under_voltage(what)
        if self._collects_first:
            until = record.program.length - 1
            self._probe.play(record, until=until, stall_timeout=self._deadlines.stall)
            self._probe.send(record, record.program.length - record.sent)
            self._probe.spin_for(0.05)
        return record

    def _ramp_defects(self, record: RunRecord, streams: Sequence[str]) -> list[str]:
        """Return what is wrong with a ramp; one that is not measured cannot be judged."""
        if self._collects_first and not record.blocks.get(MEASURED_MONITOR):
            return []
        return [*ramp_defects(record, streams)]

    def _stop_gently(self) -> None:
        record = self._under_voltage("stop", 80e-3)
        rate = self._parameters.sample_rate
        planned = record.program.length
        ramp = round(9e-3 * rate)
        stopped = replace(record.program.stopped_at(record.sent, ramp, ramp), ending=Ending.STOPPED)
        self._probe.announce(stopped)
        stall = self._deadlines.stall
        self._probe.play(record, stall_timeout=stall)
        self._probe.receives_all(record, self._streams, stall_timeout=stall)
        self._settle(record)
        self._probe.close_run()
        self._judge_stop(record, planned)
        if record.fault or not record.is_complete(self._streams):
            self._reactivate()
        if self._collects_first:
            self._stop_what_is_played()

    def _stop_what_is_played(self) -> None:
        """Stop a driver that has the whole program, at a time when it may be playing it."""
        record = self._at_work("stop-late")
        self._probe.announce(replace(record.program, ending=Ending.STOPPED))
        self._probe.waits_for(
            lambda: record.fault or record.is_complete(self._streams), 2.0 * self._deadlines.stall
        )
        self._settle(record)
        self._probe.close_run()
        defects = []
        if not record.fault and not record.is_complete(self._streams):
            defects.append(
                f"neither a fault nor the rest of the run after a stop: {_story(record)}"
            )
        elif not record.fault and not is_at_zero(record):
            defects.append(f"the voltage stays on after the stop: {_story(record)}")
        self.findings.judge("S3", defects, f"stopped with all of it in memory: {_story(record)}")
        if record.fault:
            self._reactivate()

    def _judge_stop(self, record: RunRecord, planned: int) -> None:
        length = record.program.length
        defects = []
        if record.consumed != length and not record.fault:
            told = "" if is_at_zero(record) else "ignores the stop: "
            told += f"acknowledges {record.consumed} samples"
            defects.append(f"{told} of a program that was stopped at {length}")
        ends = {stream: record.end_index(stream) for stream in self._streams}
        late = {stream: end for stream, end in ends.items() if end > length}
        early = {stream: end for stream, end in ends.items() if end < length}
        if late:
            defects.append(
                f"ignores the stop: {_listed(late)} samples, although the program of {planned} "
                f"was cut to {length}"
            )
        elif early and not record.fault:
            defects.append(f"streams end before the stopped program's {length}: {_listed(early)}")
        if not is_at_zero(record):
            defects.append(f"the voltage stays at {last_voltage(record):.4g} V after the stop")
        text = f"cut from {planned} to {length} samples; {last_voltage(record):.3f} V at the end"
        if self._collects_first:
            self.findings.judge("S3", defects, text)
            self.findings.skips("S2", "the driver plays from a memory of its own: see S3")
        else:
            self.findings.judge("S2", defects, text)
            self.findings.skips("S3", "the driver plays block by block: see S2")

    def _interrupt_by_another(self) -> None:
        first = self._under_voltage("interrupted")
        program = short_program(self._parameters, self._next_id("after"))
        second = self._play_all(program)
        self._settle(first)
        defects = self._ramp_defects(first, (MEASURED_MONITOR,))
        if not second.is_complete(self._streams):
            told = second.fault or f"{second.consumed} of {program.length} samples acknowledged"
            defects.append(f"the run after it was not played: {told}")
        begin = second.samples(MEASURED_MONITOR)[:10]
        if begin.size and abs(float(begin.mean())) > 1.0:
            defects.append(f"the run after it begins at {float(begin.mean()):.3g} V, not at rest")
        self.findings.judge("S8", defects, f"{program.run_id} played whole after a ramp")
        self._reactivate()

    def _abandon(self) -> None:
        record = self._at_work("abandoned")
        self._probe.announce(replace(record.program, ending=Ending.ABANDONED))
        wait = 1.0 if self._collects_first else self._deadlines.stall
        self._probe.waits_for(lambda: record.fault, wait)
        self._settle(record)
        self._probe.close_run()
        if self._collects_first and not record.fault:
            defects = [] if not record.blocks else ["plays on although the program is abandoned"]
        else:
            defects = self._own_stop_defects(record, "abandoned")
        self.findings.judge("S4", defects, _story(record))
        self._judge_after_fault(record)

    def _own_stop_defects(self, record: RunRecord, text: str = "") -> list[str]:
        return [*self._ramp_defects(record, self._streams), *fault_defects(record, text)]

    def _judge_after_fault(self, record: RunRecord) -> None:
        """Send more of a run that ended by a fault, then a new activation and a whole run."""
        if record.fault:
            before = (record.consumed, record.end_index(MEASURED_MONITOR))
            self._probe.send(record, 100)
            self._probe.spin_for(0.3)
            after = (record.consumed, record.end_index(MEASURED_MONITOR))
            defects = [] if after == before else ["takes more of a run that ended by a fault"]
            self.findings.judge("S9", defects, "takes nothing more of a run with a fault")
        self._reactivate("S9")
        program = short_program(self._parameters, self._next_id("after-fault"), 2e-3)
        again = self._play_all(program)
        text = f"run {program.run_id} played whole after deactivate and activate"
        is_whole = again.is_complete(self._streams) and not again.fault
        defects = [] if is_whole else [f"after its fault, run {program.run_id}: {_story(again)}"]
        self.findings.judge("S9", defects, text)
        self.findings.judge("L6", defects, text)
        if defects:
            raise CheckAborted(defects[0])

    def _exceed_range(self) -> None:
        settings = self._parameters
        builder = ProgramBuilder(settings)
        builder.level(settings.highest_voltage + 20.0, 20e-3, "beyond")
        builder.level(settings.lowest_voltage - 20.0, 20e-3, "below")
        builder.level(0.0, 10e-3, "release")
        record = self._play_all(builder.build(self._next_id("range")))
        self._settle(record)
        defects = [*clipping_defects(record, settings.lowest_voltage, settings.highest_voltage)]
        if record.fault:
            defects += self._own_stop_defects(record)
        shown = record.samples(MEASURED_MONITOR)
        span = (
            f"{shown.min():.4g} to {shown.max():.4g} V shown" if shown.size else "nothing put out"
        )
        how = f"refused: {record.fault}" if record.fault else "limited, with flag"
        self.findings.judge("V2", defects, f"{how}; {span}")
        self._reactivate()

    def _send_nan(self) -> None:
        record = self._under_voltage("nan")
        wrong = record.program.render(record.sent, 100)
        wrong[50] = np.nan
        self._probe.send(record, 100, wrong)
        self._probe.waits_for(lambda: record.fault, self._deadlines.stall)
        self._settle(record)
        self._probe.close_run()
        findings = Findings()
        check_streams(record, self._streams, findings, to_the_end=False)
        self._adopt("V3", findings, f"no such sample in any stream; {_story(record)}")
        self.findings.judge("V3", fault_defects(record), f"told: {record.fault}")
        self.findings.judge("S6", self._own_stop_defects(record), f"not a number: {_story(record)}")
        self._judge_diagnostics(record)
        self._judge_after_fault(record)
        self._judge_cleared_diagnostics()

    def _judge_diagnostics(self, record: RunRecord) -> None:
        """Look for the reason of the fault where an operator looks for it."""
        if not record.fault:
            return

        def told() -> list[str]:
            status = self._probe.status_of(self._nodes)
            return [text for is_error, text in status if is_error and text]

        self._probe.waits_for(
            lambda: any(text in record.fault or record.fault in text for text in told()),
            _DIAGNOSTICS_TIME,
        )
        found = told()
        is_there = any(text in record.fault or record.fault in text for text in found)
        what = f"errors there: {'; '.join(found)}" if found else "no error there"
        defects = [] if is_there else [f"the fault {record.fault!r} is not there; {what}"]
        self.findings.judge("I4", defects, "a fault of drive/progress stood there as an error")

    def _judge_cleared_diagnostics(self) -> None:
        def errors() -> list[str]:
            return [text for is_error, text in self._probe.status_of(self._nodes) if is_error]

        self._probe.waits_for(lambda: not errors(), _DIAGNOSTICS_TIME)
        found = errors()
        defects = [f"still there after a new activation: {'; '.join(found)}"] if found else []
        self.findings.judge("I4", defects, "gone after a new activation")

    def _send_gap(self) -> None:
        record = self._under_voltage("gap")
        self._probe.skip(record, 1)
        self._probe.send(record, 100)
        self._probe.waits_for(lambda: record.fault, self._deadlines.stall)
        self._settle(record)
        self._probe.close_run()
        self.findings.judge(
            "S6", self._own_stop_defects(record), f"a sample is missing: {_story(record)}"
        )
        self._reactivate("S9")

    def _fall_silent(self) -> None:
        """Silence of blocks is no reason to stop as long as the generator says that it lives."""
        timeout = self._parameters.voltage_timeout
        record = self._under_voltage("silent")
        if self._collects_first:
            self._judge_silence_while_collecting(record)
            return
        self._probe.spin_for(1.3 * timeout)
        if record.fault:
            self.findings.fails("S5", f"gives up although the generator lives: {record.fault}")
        else:
            self.findings.passes("S5", f"waits {1.3 * timeout:.1f} s for a generator that lives")
            self._judge_silence(record)
        self._probe.close_run()
        self._reactivate("S9")

    def _judge_silence_while_collecting(self, record: RunRecord) -> None:
        """Nothing may be put out of a program that is not there as a whole."""
        self._probe.is_pulsing = False
        self._probe.spin_for(1.5 * self._parameters.voltage_timeout)
        self._probe.is_pulsing = True
        self._probe.close_run()
        defects = ["puts out a program that is not there as a whole"] if record.blocks else []
        self.findings.judge("S5", defects, f"nothing put out of half a program; {_story(record)}")
        self._reactivate("S9")

    def _judge_silence(self, record: RunRecord) -> None:
        timeout = self._parameters.voltage_timeout
        self._probe.is_pulsing = False
        began = time.monotonic()
        self._probe.waits_for(lambda: record.fault, timeout + 1.5)
        waited = time.monotonic() - began
        self._settle(record)
        self._probe.is_pulsing = True
        defects = self._own_stop_defects(record, "no voltage")
        if record.fault and waited < 0.8 * timeout:
            defects.append(f"gives up after {waited:.2f} s, before {timeout:g} s have passed")
        self.findings.judge("S5", defects, f"after {waited:.2f} s of silence: {_story(record)}")

    def _deactivate_under_voltage(self) -> None:
        record = self._at_work("deactivated")
        self._transit(DEACTIVATE)
        self._settle(record)
        self._probe.close_run()
        self.findings.judge(
            "S7", self._ramp_defects(record, (MEASURED_MONITOR,)), f"deactivated: {_story(record)}"
        )

    def _return_from_unconfigured(self) -> None:
        self._transit(CLEAN_UP)
        self._transit(CONFIGURE)
        self._transit(ACTIVATE)

    def _end_under_voltage(self) -> None:
        if self._processes is None:
            self.findings.skips("S7", "SIGTERM: the driver was not started by this check")
            return
        record = self._at_work("ended")
        self._probe.watch = _nothing
        self._processes.request_stop()
        processes = self._processes
        self._probe.waits_for(lambda: not processes.are_running, self._deadlines.end)
        self._settle(record)
        self._probe.close_run()
        survivors = self._processes.stop(0.0)
        defects = self._ramp_defects(record, (MEASURED_MONITOR,))
        defects += [f"{name} does not end within {self._deadlines.end:g} s" for name in survivors]
        self.findings.judge("S7", defects, f"SIGTERM: {_story(record)}")
        self._judge_exit("S7")
        self._processes = None

    def _judge_exit(self, requirement: str) -> None:
        assert self._processes is not None
        codes = self._processes.exit_codes()
        wrong = {name: code for name, code in codes.items() if code not in (0, None)}
        self.findings.judge(
            requirement, [f"exit codes {_listed(wrong)}"] if wrong else [], "ended with exit code 0"
        )

    # ---- readers -------------------------------------------------------------------------

    def _miss_a_reader(self) -> None:
        self._activate_without_reader()
        self._transit(ACTIVATE)
        record = self._under_voltage("reader-leaves")
        missing = topic_named(self._streams[0])
        self._probe.stop_reading(missing)
        is_whole = self._probe.play(record, stall_timeout=self._deadlines.stall)
        self._probe.close_run()
        self._probe.read(missing)
        defects = [] if is_whole else [f"stops when a reader leaves: {_story(record)}"]
        self.findings.judge("F5", defects, f"plays on when the reader of {missing.name} leaves")
        self._transit(DEACTIVATE)

    def _activate_without_reader(self) -> None:
        """Activate with a reader missing: refused in time with a reason, or granted and played."""
        missing = topic_named(self._streams[0])
        self._probe.stop_reading(missing)
        patience = self._probe.get_parameters(self._nodes, _PATIENCE, self._deadlines.transition)
        self._set_patience(dict.fromkeys(patience, 1.0))
        try:
            self._probe.change(self._nodes, ACTIVATE, self._deadlines.transition)
            states = self._states()
        except DeadlineError as error:
            self.findings.fails("F5", f"hangs without a reader of {missing.name}: {error}")
            raise CheckAborted("it hangs in activate") from error
        refused = [node for node, state in states.items() if state != "active"]
        if refused:
            text = f"{', '.join(refused)} does not activate without a reader of {missing.name}"
            self.findings.passes("F5", text)
        elif not self._probe.is_replay:
            self._play_unread(missing)
        active = [node for node, state in states.items() if state == "active"]
        if active:
            self._probe.change(active, DEACTIVATE, self._deadlines.transition)
        self._probe.read(missing)
        self._set_patience(patience)

    def _set_patience(self, seconds: Mapping[str, float]) -> None:
        """Say how long nodes wait for their peers, those that have the parameter for it."""
        self._probe.set_parameters(seconds, _PATIENCE, self._deadlines.transition)

    def _play_unread(self, missing: Topic) -> None:
        program = short_program(self._parameters, self._next_id("nobody"), 2e-3)
        record = self._probe.announce(program)
        is_whole = self._probe.play(record, stall_timeout=self._deadlines.stall)
        self._probe.close_run()
        defects = [] if is_whole else [f"does not play without a reader of {missing.name}"]
        self.findings.judge("F5", defects, f"plays without a reader of {missing.name}")

    def _await_replay(self) -> RunRecord:
        if not self._probe.waits_for(lambda: self._probe.runs, self._deadlines.stall):
            raise CheckAborted("no program came on drive/program")
        record = next(iter(self._probe.runs.values()))
        self._probe.receives_all(record, self._streams, stall_timeout=self._deadlines.stall)
        # the topics of a recorded run are heard in any order: by the end all of it was sent
        record.progress = [replace(one, sent=record.sent) for one in record.progress]
        return record

    # ---- end -----------------------------------------------------------------------------

    def _shut_down(self) -> None:
        if self._start is None:
            self.findings.skips("L4", "the driver was not started by this check, and goes on")
            self._bring_to_unconfigured(self._states())
            return
        if self._processes is None and self._lives < _LIVES:
            self.findings.skips("L4", "the driver was to be started once only")
            return
        processes = self._processes or self._start()
        self._processes = processes
        self._probe.watch = processes.check
        self._probe.await_managed(self._nodes, self._deadlines.start)
        self._probe.watch = _nothing
        try:
            self._probe.change(self._nodes, SHUTDOWN, self._deadlines.transition)
        except DeadlineError as error:  # it may have ended before its answer came through
            if processes.are_running:
                self.findings.fails("L4", str(error))
        self._probe.waits_for(lambda: not processes.are_running, self._deadlines.end)
        survivors = processes.survivors(0.0)
        defects = [f"{name} runs on after shutdown" for name in survivors]
        self.findings.judge("L4", defects, "ended by the transition shutdown")
        if not survivors:
            self._judge_exit("L4")


MEASURED_MONITOR = "drive/voltage_monitor"


def _nothing() -> None:
    """Watch nothing."""


def _listed(values: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())


def _story(record: RunRecord) -> str:
    """Return how a run ended."""
    end = record.end_index(MEASURED_MONITOR)
    shown = f"{last_voltage(record):.3f} V at the end" if end else "no voltage to be seen"
    told = f"fault {record.fault!r}" if record.fault else "no fault told"
    return f"{record.consumed} samples acknowledged, {end} measured, {shown}, {told}"


def _type_defects(topic: Topic, info: Any, verb: str, own_hash: str) -> list[str]:
    if info.topic_type != topic.type_name:
        what = f"{info.node_name} {verb} {topic.name} as {info.topic_type}"
        return [f"{what}, expected {topic.type_name}"]
    if own_hash and str(info.topic_type_hash) != own_hash:
        return [f"{info.node_name} {verb} {topic.name} by another definition of {topic.type_name}"]
    return []


def _quality_defects(topic: Topic, info: Any, verb: str) -> list[str]:
    defects = []
    quality = info.qos_profile
    if quality.reliability is not ReliabilityPolicy.RELIABLE:
        defects.append(f"{info.node_name} {verb} {topic.name} best effort, expected reliable")
    is_latched = quality.durability is DurabilityPolicy.TRANSIENT_LOCAL
    if topic.intent is Intent.LATCHED and not is_latched:
        defects.append(f"{info.node_name} {verb} {topic.name} volatile, expected transient local")
    return defects
