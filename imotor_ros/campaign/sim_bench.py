"""The bench in one process: the same roles, messages and bag as on the ROS graph, without it."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from types import TracebackType
from typing import Any, Self

import numpy as np

from imotor_ros.bag.types import BagTypes, installed_types
from imotor_ros.campaign.bench import (
    DriveAdvanced,
    ExcitationAdvanced,
    PerformanceReported,
    PhaseEntered,
    RunEvent,
)
from imotor_ros.campaign.plan import RunPlan
from imotor_ros.campaign.roles.evaluator import EvaluatorRole
from imotor_ros.campaign.roles.generator import GeneratorRole
from imotor_ros.campaign.roles.instrument import Instrument, InstrumentRole
from imotor_ros.campaign.roles.plant import PlantRole
from imotor_ros.campaign.roles.recorder import RecorderRole
from imotor_ros.contracts import topics
from imotor_ros.contracts.blocks import SampleBlock, sample_time
from imotor_ros.contracts.messages import (
    block_to_message,
    channel_to_message,
    performance_to_message,
    program_to_message,
    progress_to_message,
    run_info_to_message,
)
from imotor_ros.contracts.topics import Topic, topic_named
from imotor_ros.core.correction import Excitation, ExcitationRequest
from imotor_ros.core.force_sensor import ForceSensor
from imotor_ros.core.trial import Recording, Steps, Trial
from imotor_ros.core.vibrometer import Vibrometer
from imotor_ros.errors import BadInputError


class SimBench:
    """Carries out runs in this process, as fast as it computes; see `Bench`."""

    name = "sim"

    def __enter__(self) -> Self:
        """Return the bench."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Do nothing: there is nothing to stop."""

    def excite(
        self, plan: RunPlan, request: ExcitationRequest
    ) -> Generator[RunEvent, None, Excitation]:
        """Find the voltage for a motion; see `Bench.excite`."""
        _refuse_driver(plan)
        search = Steps(request.procedure(plan.limits))
        while search.trial is not None:
            trial = search.trial
            yield ExcitationAdvanced(trial.stage, trial.amplitude_error, trial.phase_error)
            search.send(play_trial(trial, plan))
        return search.result

    def play(self, trial: Trial, plan: RunPlan) -> Recording:
        """Play a trial; see `TrialPlayer`."""
        return play_trial(trial, plan)

    def run(self, plan: RunPlan) -> Iterator[RunEvent]:
        """Carry out one run; see `Bench.run`."""
        _refuse_driver(plan)
        plan.prepare_folder()
        yield PhaseEntered("run")
        run = _SimRun(plan)
        try:
            yield from run.carry_out()
        except BaseException as error:
            run.close(f"{type(error).__name__}: {error}")
            raise
        run.close()


def _refuse_driver(plan: RunPlan) -> None:
    if not plan.driver.is_virtual:
        raise BadInputError(
            "is a node of its own, which this bench does not start", where="driver",
            value=plan.driver.executable, bound='"virtual", or the bench "ros"',
        )  # fmt: skip


def play_trial(trial: Trial, plan: RunPlan) -> Recording:
    """
    Play a trial and return the rod velocity, as generator, plant and vibrometer make it.

    Parameters
    ----------
    trial : Trial
        What to play.
    plan : RunPlan
        The run whose stand it is played on.

    """
    stand, seed, program = plan.parameters.stand, plan.parameters.seed, trial.program
    generator = GeneratorRole(program, stand.block_length, 1, plan.limits)
    plant = PlantRole(stand.motor, seed, program)
    name = topics.ROD_VELOCITY.name
    head = Vibrometer(stand.rod_vibrometer, program.sample_rate, seed, name)
    instrument = InstrumentRole(head, program)
    parts, flags = [], 0
    while (block := generator.next_block()) is not None:
        moved = next(
            one
            for one in plant.process(block).blocks
            if one.stream == topics.TRUE_ROD_VELOCITY.name
        )
        measured = instrument.process(moved)
        generator.acknowledge(plant.consumed)
        parts.append(measured.samples)
        flags |= measured.flags
    return Recording(program, {name: np.concatenate(parts)}, {name: head.channel}, {name: flags})


class _SimRun:
    """One run: the roles, and the recorder that gets all messages."""

    def __init__(self, plan: RunPlan) -> None:
        point = plan.parameters
        stand, seed = point.stand, point.seed
        self._program = plan.program
        rate = plan.program.sample_rate
        self._types: BagTypes = installed_types()
        self._generator = GeneratorRole(plan.program, stand.block_length, 1, plan.limits)
        self._plant = PlantRole(stand.motor, seed, plan.program)
        instruments: dict[Topic, Instrument] = {
            topics.TRUE_ROD_VELOCITY: Vibrometer(
                stand.rod_vibrometer, rate, seed, topics.ROD_VELOCITY.name
            ),
            topics.TRUE_SLIDER_VELOCITY: Vibrometer(
                stand.slider_vibrometer, rate, seed, topics.SLIDER_VELOCITY.name
            ),
            topics.TRUE_LOAD_FORCE: ForceSensor(
                stand.force_sensor, rate, seed, topics.LOAD_FORCE.name
            ),
        }
        self._instruments = {
            truth.name: InstrumentRole(one, plan.program) for truth, one in instruments.items()
        }
        names = tuple(topic.name for topic in topics.MEASURED_TOPICS)
        self._evaluator = EvaluatorRole(point.evaluator, names, point.report_interval, plan.program)
        self._recorder = RecorderRole(
            plan.bag_path,
            plan.program,
            run_info=plan.run_info,
            provenance=plan.provenance,
            report_interval=point.report_interval,
            types=self._types,
        )
        self._plan = plan

    def carry_out(self) -> Iterator[RunEvent]:
        """Run to the end of the program."""
        self._announce()
        while (block := self._generator.next_block()) is not None:
            self._record_block(block)
            yield from self._step(block)
            self._generator.acknowledge(self._plant.consumed)
            yield DriveAdvanced(self._plant.consumed, self._program.length)

    def _announce(self) -> None:
        program, types = self._program, self._types
        info = run_info_to_message(types, program.run_id, program.epoch, self._plan.run_info_json)
        self._record(topics.RUN_INFO, info)
        self._record(topics.DRIVE_PROGRAM, program_to_message(types, program))
        described = [*self._plant.channels]
        for instrument in self._instruments.values():
            described += instrument.channels
        for channel in described:
            self._evaluator.add_channel(channel)
            message = channel_to_message(types, channel, program.run_id, program.epoch)
            self._record(topics.CHANNELS, message)

    def _step(self, voltage: SampleBlock) -> Iterator[RunEvent]:
        output = self._plant.process(voltage)
        for made in output.blocks:
            self._record_block(made)
            instrument = self._instruments.get(made.stream)
            measured = instrument.process(made) if instrument else made
            if instrument:
                self._record_block(measured)
            self._evaluator.add_block(measured)
        self._record_progress(output.flags)
        for performance in self._evaluator.reports():
            time = self._time(performance.end_index)
            message = performance_to_message(self._types, performance, time)
            self._record(topics.PERFORMANCE, message)
            yield PerformanceReported(performance)

    def _record_progress(self, flags: int) -> None:
        consumed = self._plant.consumed
        message = progress_to_message(
            self._types, self._program.run_id, self._time(consumed), consumed, flags
        )
        self._record(topics.DRIVE_PROGRESS, message)

    def _time(self, index: int) -> int:
        return sample_time(self._program.epoch, index, self._program.sample_rate)

    def _record_block(self, block: SampleBlock) -> None:
        self._record(topic_named(block.stream), block_to_message(self._types, block))

    def _record(self, topic: Topic, message: Any) -> None:
        # in this process there is no reception, and every recorded message has a time of the run
        self._recorder.add(topic.name, self._types.serialize(message), received=0)

    def close(self, reason: str = "") -> None:
        """Close the bag."""
        self._recorder.close(reason)
