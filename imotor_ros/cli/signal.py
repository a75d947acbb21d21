"""
Print the harmonics of a drive signal.

The signal is the ideal parabolic sawtooth, cut to its first harmonics with Lanczos' sigma
factors and scaled to the stroke. Phases are those of sines; the phase of harmonic k is given
relative to k times that of the first.
"""

from __future__ import annotations

import argparse
import math

from imotor_ros.cli.output import print_json, table
from imotor_ros.core.signals import classic_sawtooth, parabolic_sawtooth
from imotor_ros.errors import BadInputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("--harmonics", type=int, required=True, metavar="N", help="how many")
    parser.add_argument(
        "--stroke", type=float, default=15e-6, metavar="M", help="peak to peak (m), default 15e-6"
    )
    parser.add_argument(
        "--shape",
        choices=("parabolic_sawtooth", "classic_sawtooth"),
        default="parabolic_sawtooth",
        help="ideal signal",
    )


def run(options: argparse.Namespace) -> int:
    """Print the harmonics."""
    if options.harmonics < 1:
        raise BadInputError(
            "is out of bounds", where="--harmonics", value=options.harmonics, bound=">= 1"
        )
    if not (math.isfinite(options.stroke) and options.stroke > 0):
        raise BadInputError(
            "is out of bounds", where="--stroke", value=options.stroke, bound="> 0 m"
        )
    make = parabolic_sawtooth if options.shape == "parabolic_sawtooth" else classic_sawtooth
    motion = make(options.harmonics, options.stroke, fundamental_frequency=1.0)
    amplitudes, phases = list(motion.amplitudes), list(motion.relative_phases)
    if options.json:
        print_json(
            {
                "shape": options.shape,
                "harmonics": options.harmonics,
                "stroke": options.stroke,
                "amplitudes": amplitudes,
                "phases": phases,
            }
        )
        return 0
    rows = [
        [str(k), f"{amplitude * 1e6:.3f}", f"{math.degrees(phase):.2f}"]
        for k, (amplitude, phase) in enumerate(zip(amplitudes, phases, strict=True), 1)
    ]
    print(table(rows, ["harmonic", "amplitude (um)", "phase (deg)"]))
    return 0
