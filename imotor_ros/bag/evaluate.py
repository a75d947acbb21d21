"""The indicators of a recorded run, from the code that computes them live."""

from __future__ import annotations

from pathlib import Path

from imotor_ros.bag.reader import RunBag
from imotor_ros.contracts.blocks import stamp_error
from imotor_ros.contracts.topics import MEASURED_TOPICS
from imotor_ros.core.evaluator import EvaluatorParameters, RunEvaluator
from imotor_ros.core.indicators import Performance


def evaluate_bag(path: Path | str, parameters: EvaluatorParameters | None = None) -> Performance:
    """
    Evaluate a recorded run.

    Parameters
    ----------
    path : Path
        The bag.
    parameters : EvaluatorParameters, optional
        How to evaluate; by default as in the run, which its run info tells.

    Returns
    -------
    Performance
        Final, unless the bag ends before the program does.

    Raises
    ------
    UnreadableFileError
        If the bag cannot be read, or holds no drive program.

    """
    with RunBag(path) as bag:
        evaluator = RunEvaluator(parameters or recorded_parameters(bag))
        evaluator.begin(bag.program)
        names = [topic.name for topic in MEASURED_TOPICS if topic.name in bag.topics]
        for channel in bag.channels.values():
            if channel.name in names:
                evaluator.add_channel(channel)
        for block in bag.blocks(*names) if names else ():
            evaluator.add_samples(
                block.stream, block.first_index, block.samples, block.flags, block.sample_rate,
                stamp_error(block, bag.program.epoch, bag.program.sample_rate),
            )  # fmt: skip
        return evaluator.performance()


def recorded_parameters(bag: RunBag) -> EvaluatorParameters:
    """
    Return the evaluator's parameters in a bag's run info; the defaults where it has none.

    Raises
    ------
    BadInputError
        If they are not parameters of this version's evaluator.

    """
    point = bag.run_info.get("parameters", {})
    return EvaluatorParameters.from_mapping(point.get("evaluator", {}), f"{bag.path}: evaluator")
