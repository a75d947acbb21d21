"""Broken drivers are caught by the check of drivers and by the running stand, by name."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from imotor_msgs.action import PlayProgram
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from imotor_ros.campaign.conformance.flow_checks import check_flow
from imotor_ros.campaign.conformance.programs import CheckParameters, characterising_program
from imotor_ros.campaign.conformance.record import (
    MEASURED,
    Acknowledgement,
    Description,
    Published,
    RunRecord,
)
from imotor_ros.campaign.conformance.requirements import Findings, Verdict, conclude
from imotor_ros.campaign.conformance.signal_checks import (
    RunSignals,
    check_alignment,
    check_clock,
    check_identity,
    check_voltage,
)
from imotor_ros.campaign.conformance.stream_checks import check_channels, check_streams
from imotor_ros.campaign.plan import drive_program
from imotor_ros.campaign.point import PointParameters
from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import (
    block_from_message,
    channel_from_message,
    message_time,
    performance_from_message,
    program_to_message,
)
from imotor_ros.core.channel import ROD_VELOCITY, SLIDER_VELOCITY
from imotor_ros.core.drive import DriveProgram, Ending
from imotor_ros.core.indicators import Performance
from imotor_ros.nodes.card_driver import Measured
from imotor_ros.nodes.evaluator import EvaluatorNode
from imotor_ros.nodes.signal_generator import SignalGeneratorNode
from imotor_ros.nodes.template_driver import TemplateDriverNode

SETTINGS = CheckParameters()
BLOCK = 10_000


# ---- the template driver, each with one small override -------------------------------------


class _ChangesSamples(TemplateDriverNode):
    """Changes what was measured before anybody sees it."""

    def read(self) -> Measured:
        measured = super().read()
        return replace(measured, samples=self.change(dict(measured.samples)))

    def change(self, samples: dict[str, Any]) -> dict[str, Any]:
        raise NotImplementedError


class WrongUnit(_ChangesSamples):
    """The slider's velocity is in mm/s."""

    def change(self, samples: dict[str, Any]) -> dict[str, Any]:
        return {n: x * 1e3 if n == SLIDER_VELOCITY else x for n, x in samples.items()}


class SwappedChannels(_ChangesSamples):
    """The cables of the two vibrometers are swapped."""

    def change(self, samples: dict[str, Any]) -> dict[str, Any]:
        other = {ROD_VELOCITY: SLIDER_VELOCITY, SLIDER_VELOCITY: ROD_VELOCITY}
        return {name: samples[other.get(name, name)] for name in samples}


class HiddenDelay(_ChangesSamples):
    """The rod's velocity comes 20 samples late, and the channel does not say so."""

    _kept = np.zeros(20)

    def change(self, samples: dict[str, Any]) -> dict[str, Any]:
        if not samples:
            return samples
        joined = np.concatenate([self._kept, samples[ROD_VELOCITY]])
        self._kept = joined[-20:]
        return {**samples, ROD_VELOCITY: joined[:-20]}


class NotANumber(_ChangesSamples):
    """A few samples of the slider's velocity are no numbers."""

    def change(self, samples: dict[str, Any]) -> dict[str, Any]:
        for name, values in samples.items():
            if name == SLIDER_VELOCITY and len(values) > 100:
                values[50:53] = np.nan
        return samples


class _ChangesBlocks(TemplateDriverNode):
    """Changes blocks as they are published."""

    def publish_block(self, block: SampleBlock) -> None:
        super().publish_block(self.change(block))

    def change(self, block: SampleBlock) -> SampleBlock:
        raise NotImplementedError


class SampleMissing(_ChangesBlocks):
    """One sample of the slider's velocity is lost."""

    def change(self, block: SampleBlock) -> SampleBlock:
        if block.stream == SLIDER_VELOCITY and block.sequence == 2:
            return replace(block, first_index=block.first_index + 1, samples=block.samples[1:])
        return block


class WrongRate(_ChangesBlocks):
    """The rod's blocks say another sample rate than the program."""

    def change(self, block: SampleBlock) -> SampleBlock:
        is_rod = block.stream == ROD_VELOCITY
        return replace(block, sample_rate=0.5 * block.sample_rate) if is_rod else block


class WallClock(_ChangesBlocks):
    """The stamps are the time of publication."""

    def change(self, block: SampleBlock) -> SampleBlock:
        return replace(block, time=time.time_ns())


class NeverAcknowledges(TemplateDriverNode):
    """Plays, measures, and says nothing of it."""

    def _report(self, flags: int, fault: str = "") -> None:
        if fault:
            super()._report(flags, fault)


class AcknowledgesTooEarly(TemplateDriverNode):
    """Acknowledges what it has not got yet."""

    @property
    def consumed(self) -> int:
        """More than there is."""
        return super().consumed + 100_000


class IgnoresStop(TemplateDriverNode):
    """Once it is to stop it takes no more, and leaves the voltage where it is."""

    _is_deaf = False

    def change_run(self, program: DriveProgram) -> None:
        self._is_deaf = program.ending is not Ending.PLANNED

    def process_block(self, block: SampleBlock) -> None:
        if not self._is_deaf:
            super().process_block(block)

    def bring_down(self) -> bool:
        return False


# ---- the stand around them -------------------------------------------------------------------


def a_run() -> DriveProgram:
    """Return a run in which the slider runs freely for many periods, without correction."""
    point = PointParameters.from_leaves({"drive.hold_time": 0.03, "report_interval": 0.0})
    return drive_program(point, "run")


class Stand:
    """A driver, an evaluator, and a probe in the generator's place, in one process."""

    def __init__(self, graph: Any, kind: Any) -> None:
        self.graph = graph
        graph.write(topics.DRIVE_PROGRAM, topics.DRIVE_VOLTAGE, topics.STATE)
        self.heard = {topic.name: graph.hear(topic) for topic in topics.MEASURED_TOPICS}
        self.progress = graph.hear(topics.DRIVE_PROGRESS)
        self.channels = graph.hear(topics.CHANNELS)
        self.performances = graph.hear(topics.PERFORMANCE)
        self.driver = graph.add(kind)
        self.evaluator = graph.add(EvaluatorNode, report_interval=0.0)
        graph.start(self.driver, self.evaluator)

    def play(self, program: DriveProgram) -> RunRecord:
        """Send a program block by block, and return what came of it."""
        self.graph.announce(program)
        record = RunRecord(program)
        for number, first in enumerate(range(0, program.length, BLOCK)):
            count = min(BLOCK, program.length - first)
            moment = sample_time(program.epoch, first, program.sample_rate)
            samples = program.render(first, count)
            record.voltage.append(samples)
            record.sent += count
            name = topics.DRIVE_VOLTAGE.name
            block = SampleBlock(
                name, program.run_id, moment, number, first, program.sample_rate, "V", 0, samples
            )
            self.graph.send_block(block)
        self.graph.spin_until(
            lambda: all(self._end(program, name) >= program.length for name in MEASURED),
            "all streams to come to their end",
        )
        self.graph.spin(0.05)  # the acknowledgement of the last block, if there is one
        return self._fill(record)

    def _of(self, program: DriveProgram, messages: list[Any]) -> list[Any]:
        return [one for one in messages if one.run_id == program.run_id]

    def _end(self, program: DriveProgram, name: str) -> int:
        blocks = self._of(program, self.heard[name])
        return blocks[-1].first_index + len(blocks[-1].samples) if blocks else 0

    def _fill(self, record: RunRecord) -> RunRecord:
        program = record.program
        for name, messages in self.heard.items():
            blocks = map(block_from_message, self._of(program, messages))
            record.blocks[name] = [Published(number, one) for number, one in enumerate(blocks)]
        record.progress = [
            Acknowledgement(
                0, record.sent, message_time(one), int(one.consumed), int(one.flags), one.fault
            )
            for one in self._of(program, self.progress)
        ]
        for one in self._of(program, self.channels):
            described = Description(one.run_id, message_time(one), channel_from_message(one))
            record.descriptions[one.name] = described
        return record

    def indicators(self, program: DriveProgram) -> Performance:
        """Play a program, and wait for its final indicators."""
        self.play(program)

        def final() -> list[Any]:
            return [one for one in self._of(program, self.performances) if one.is_final]

        self.graph.spin_until(
            lambda: self.evaluator.fault or final(), f"the final indicators of {program.run_id}"
        )
        assert not self.evaluator.fault
        return performance_from_message(final()[-1])


def failures(record: RunRecord) -> dict[str, str]:
    """Return what the check of drivers says against a driver, by requirement."""
    findings = Findings()
    check_streams(record, MEASURED, findings)
    check_flow(record, findings)
    check_channels(record, MEASURED, findings)
    if record.is_complete(()):
        signals = RunSignals(record)
        check_voltage(signals, findings)
        check_identity(signals, findings)
        check_alignment(signals, MEASURED, findings, SETTINGS.alignment_tolerance)
        check_clock(signals, MEASURED, findings)
    results = conclude(findings, "not part of this test")
    return {one.requirement.id: one.evidence for one in results if one.verdict is Verdict.FAIL}


def test_template_is_caught_by_nothing(graph: Any) -> None:
    """Otherwise nothing would follow from the others being caught."""
    stand = Stand(graph, TemplateDriverNode)
    assert failures(stand.play(characterising_program(SETTINGS, "check"))) == {}
    found = stand.indicators(a_run())
    for name in ("mean_velocity", "ripple", "durability", "efficiency"):
        assert found.indicator(name).is_available, found.indicator(name).reason
    assert not found.warnings


@pytest.mark.parametrize(
    ("mutant", "requirement", "evidence", "reason"),
    [
        (WrongUnit, "A1|D5", "slider", "slider/velocity are at the end of its range"),
        (SwappedChannels, "A1", "swapped", "rod/velocity has a mean of .* another channel"),
        (SampleMissing, "D1", "1 sample", "1 of .* samples of slider/velocity are missing"),
        (WrongRate, "D3", "rate", "rod/velocity is sampled at 500000 Hz, but the drive program"),
        (WallClock, "D2", "off by", "stamps of .* stamps from another clock"),
        (HiddenDelay, "A2", "rod/velocity", "rod/velocity .* late.*: undeclared delay"),
        (NotANumber, "D5", "nan", "samples of slider/velocity are not finite"),
    ],
)
def test_wrong_samples_are_caught_and_give_no_number(
    graph: Any, mutant: Any, requirement: str, evidence: str, reason: str
) -> None:
    """The check names requirement and defect; the evaluator refuses with the defect's name."""
    stand = Stand(graph, mutant)
    found = failures(stand.play(characterising_program(SETTINGS, "check")))
    assert any(re.fullmatch(requirement, name) for name in found), found
    assert any(evidence in text for name, text in found.items()), found
    durability = stand.indicators(a_run()).indicator("durability")
    assert not durability.is_available
    assert re.search(reason, durability.reason), durability.reason


class Generator:
    """The signal generator, a driver, and somebody who wants a program played."""

    def __init__(self, graph: Any, kind: Any) -> None:
        self.graph = graph
        for topic in topics.MEASURED_TOPICS:
            graph.hear(topic)
        self.driver = graph.add(kind)
        self.node = graph.add(SignalGeneratorNode, progress_timeout=0.5)
        self._client = ActionClient(graph.probe, PlayProgram, "drive/play")
        self.consumed = 0
        graph.start(self.driver, self.node)
        graph.spin_until(self._client.server_is_ready, "the action drive/play")

    def _on_feedback(self, message: Any) -> None:
        self.consumed = max(self.consumed, int(message.feedback.consumed))

    def outcome(self, program: DriveProgram, *, stop_at: int | None = None) -> str:
        """Have a program played, stopped once so much is consumed, and return the outcome."""
        goal = PlayProgram.Goal(program=program_to_message(self.graph.types, program))
        handle = self._client.send_goal_async(goal, self._on_feedback)
        self.graph.spin_until(handle.done, "the goal to be taken")
        answer = handle.result().get_result_async()
        if stop_at is not None:
            self.graph.spin_until(lambda: self.consumed >= stop_at, "the drive to advance")
            service = self.graph.probe.create_client(Trigger, "drive/stop")
            self.graph.spin_until(service.service_is_ready, "the service drive/stop")
            service.call_async(Trigger.Request())
        self.graph.spin_until(answer.done, "the result of the program", seconds=20.0)
        return str(answer.result().result.outcome)


@pytest.mark.parametrize(
    ("mutant", "stop_at", "outcome"),
    [
        (TemplateDriverNode, None, "completed"),
        (TemplateDriverNode, 5_000, "cancelled"),
        (NeverAcknowledges, None, "consumed nothing"),
        (AcknowledgesTooEarly, None, "acknowledges the wrong number of samples"),
        (IgnoresStop, 5_000, "consumed nothing"),
    ],
)
def test_wrong_acknowledgements_end_the_run_with_the_reason(
    graph: Any, mutant: Any, stop_at: int | None, outcome: str
) -> None:
    stand = Generator(graph, mutant)
    program = a_run() if stop_at is None else drive_program(
        PointParameters.from_leaves({"drive.hold_time": 5.0}), "long"
    )  # fmt: skip
    assert outcome in stand.outcome(program, stop_at=stop_at)
