"""
Predict the indicators with a motor model: ideal rod motion, no noise, from rest.

The values are those over the last quarter of the periods. Without --sample-rate the equations
are solved from event to event in continuous time; with it, by the virtual plant's own stepping.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict

from imotor_ros.cli.friction_option import FRICTION_HELP, friction_law
from imotor_ros.cli.output import SCALES, format_value, print_json, table
from imotor_ros.core.model import PERIODS, Prediction, predict
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.errors import BadInputError

_MOST_PERIODS = 10_000_000

_INDICATORS = ("mean_velocity", "ripple", "start_up_time", "durability", "force")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    add = parser.add_argument
    add("--harmonics", type=int, required=True, metavar="N", help="number of harmonics")
    add("--max-frequency", type=float, required=True, metavar="HZ", help="of the highest harmonic")
    add("--friction", required=True, metavar="LAW|FILE", help=FRICTION_HELP)
    add("--stroke", type=float, default=15e-6, metavar="M", help="peak to peak (m), default 15e-6")
    add(
        "--periods",
        type=int,
        default=PERIODS,
        metavar="P",
        help=f"drive periods, default {PERIODS}",
    )
    add("--load-stiffness", type=float, default=0.0, metavar="K", help="of a load spring (N/m)")
    add("--load-force", type=float, default=0.0, metavar="F", help="constant load (N), opposing")
    add("--sample-rate", type=float, metavar="HZ", help="solve by sampled stepping")


def run(options: argparse.Namespace) -> int:
    """Print the prediction."""
    prediction = _predict(options)
    if options.json:
        print_json(_mapping(options, prediction))
        return 0
    rows = []
    for name in _INDICATORS:
        value = getattr(prediction, name)
        scale = SCALES[name]
        text = "-" if value is None else format_value(value * scale.factor)
        rows.append([scale.title, text, scale.unit])
    print(table(rows, ["", "value", "unit"]))
    for name, reason in prediction.reasons.items():
        print(f"{name}: {reason}")
    print(f"{prediction.periods} periods, solver {prediction.solver}")
    return 0


def _predict(options: argparse.Namespace) -> Prediction:
    if not 4 <= options.periods <= _MOST_PERIODS:
        raise BadInputError(
            "is out of bounds",
            where="--periods",
            value=options.periods,
            bound=f"4 to {_MOST_PERIODS}",
        )
    motion = parabolic_sawtooth(
        options.harmonics, options.stroke, maximum_frequency=options.max_frequency
    )
    load = LoadParameters.free().replace(
        spring_stiffness=options.load_stiffness, constant_force=options.load_force
    )
    return predict(
        motion,
        SliderParameters(),
        friction_law(options.friction),
        load,
        periods=options.periods,
        sample_rate=options.sample_rate,
    )


def _mapping(options: argparse.Namespace, prediction: Prediction) -> dict[str, object]:
    return {
        "harmonics": options.harmonics,
        "max_frequency": options.max_frequency,
        "friction": options.friction,
        "stroke": options.stroke,
        "load_stiffness": options.load_stiffness,
        "load_force": options.load_force,
        "sample_rate": options.sample_rate,
        **asdict(prediction),
    }
