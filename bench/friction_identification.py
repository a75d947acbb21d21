"""
Is friction identification right, and are its intervals honest? Many seeds, known motors.

The stand: the paper's stator with hysteresis, voltages corrected from the measured rod motion,
heads of 125 mm/s/V with 0.5 um/s/sqrt(Hz), 100 kHz low-pass and 14 bit, no calibration error.
The default run: 2 kHz, 0.1 to 8 um and back, 40 steps each way. What rod and slider truly do is
simulated once for each motor; the noise of both heads is new with every seed.

* a motor on the line (8), one with the constant force (9): largest errors over the seeds, and
  how many of the 95 % intervals hold the truth, of all parameters and of the break-away force;
* gains of 1 % in one head: what they change;
* motors with a Stribeck law and with an elastic (LuGre) contact: what is found, over some seeds.

Run: python bench/friction_identification.py [--seeds N] [--part validated|beyond] [--json]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from functools import partial

import numpy as np

from imotor_ros.core.channel import ROD_VELOCITY, SLIDER_VELOCITY
from imotor_ros.core.digitiser import DigitiserParameters
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.friction import CoulombFriction, StribeckFriction, VelocityDependentFriction
from imotor_ros.core.identification.excitation import correct_steps
from imotor_ros.core.identification.identification import identify
from imotor_ros.core.identification.records import ChannelRecord
from imotor_ros.core.identification.stepped_sine import SteppedSineParameters, stepped_drive
from imotor_ros.core.lugre import LuGreFriction
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.trial import Recording, carry_out
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

RATE = 1e6
STEPS = SteppedSineParameters()
HEAD = VibrometerParameters(
    velocity_range=0.125,
    noise_density=0.5e-6,
    cut_off_frequency=100e3,
    calibration_uncertainty=0.0,
    digitiser=DigitiserParameters(bits=14),
)
MASS = MotorParameters().slider.mass

VALIDATED = {
    "line (8)": (
        VelocityDependentFriction(),
        "velocity",
        {"sliding_force": 0.940, "slope": 2.213},
    ),
    "constant (9)": (CoulombFriction(), "coulomb", {"sliding_force": 1.01}),
}
BEYOND = {
    "Stribeck, 15 mm/s": StribeckFriction(decay_velocity=15e-3),
    "Stribeck, 5 mm/s": StribeckFriction(decay_velocity=5e-3),
    "Stribeck, 2 mm/s": StribeckFriction(decay_velocity=2e-3),
    "break-away 1.3 N": VelocityDependentFriction(break_away_force=1.3),
    "LuGre, 2 nm": LuGreFriction(stiffness=5e8),
    "LuGre, 20 nm": LuGreFriction(stiffness=5e7),
    "LuGre, 100 nm": LuGreFriction(stiffness=1e7),
    "LuGre, 20 nm, Stribeck 20 mm/s": LuGreFriction(static_force=1.2, decay_velocity=20e-3),
}


def play(motor, trial):
    program = trial.program
    head = Vibrometer(HEAD, RATE, 0, ROD_VELOCITY)
    moved = VirtualMotor(motor, RATE, 0).process(program.render(0, program.length))
    velocity, flags = head.process(moved.rod_velocity)
    channels = {ROD_VELOCITY: head.channel}
    return Recording(program, {ROD_VELOCITY: velocity}, channels, {ROD_VELOCITY: int(flags)})


def find_program():
    """Correct the voltages; the rod does not feel the friction, so that one search does for all."""
    motor = MotorParameters()
    setting = DriveSetting("bench", 0, RATE, STEPS.offset, STEPS.bias_time, motor.drive_limits)
    voltages = carry_out(correct_steps(setting, STEPS), partial(play, motor))
    return stepped_drive(STEPS, voltages, run_id="bench", epoch=0, sample_rate=RATE)


def true_motion(program, friction):
    motor = VirtualMotor(MotorParameters(friction=friction), RATE, 0)
    parts = [
        motor.process(program.render(first, min(100_000, program.length - first)))
        for first in range(0, program.length, 100_000)
    ]
    rod = np.concatenate([one.rod_velocity for one in parts])
    return rod, np.concatenate([one.slider_velocity for one in parts])


def measured(truth, seed, gains=(1.0, 1.0)):
    records = []
    for name, velocity, gain in zip((ROD_VELOCITY, SLIDER_VELOCITY), truth, gains, strict=True):
        head = Vibrometer(HEAD, RATE, seed, name)
        samples, flags = head.process(velocity)
        assert flags == 0
        records.append(ChannelRecord(head.channel, gain * samples))
    return records


_JOB = {}


def start_worker(program, motion):
    _JOB.update(program=program, motion=motion)


def identify_seed(seed):
    return identify(_JOB["program"], *measured(_JOB["motion"], seed), MASS)


def identify_seeds(program, motion, seeds):
    """Return what every seed gives; the seeds share the processors."""
    with multiprocessing.Pool(initializer=start_worker, initargs=(program, motion)) as pool:
        return pool.map(identify_seed, range(seeds), chunksize=5)


def validate(program, name, seeds):
    friction, law, truth = VALIDATED[name]
    motion = true_motion(program, friction)
    found = identify_seeds(program, motion, seeds)
    result = {"seeds": seeds, "chosen": sum(one.chosen == law for one in found)}
    for key, value in truth.items():
        estimates = [one.fits[law].estimates[key] for one in found]
        result[key] = summary(estimates, value)
    numbers = [one.break_away.force for one in found if one.break_away.force]
    result["break_away_force"] = {"found": len(numbers), **summary(numbers, friction.break_away)}
    result["warnings"] = sum(bool(one.warnings) for one in found)
    result["calibration"] = calibrate(program, motion, law)
    return result


def summary(estimates, truth):
    errors = np.array([one.value / truth - 1.0 for one in estimates])
    return {
        "largest_error": float(np.abs(errors).max()),
        "mean_error": float(errors.mean()),
        "deviation": float(errors.std()),
        "intervals_that_hold": sum(one.holds(truth) for one in estimates),
    }


def calibrate(program, motion, law):
    """Return the relative change of each parameter by a gain of 1.01 in one head."""
    base = identify(program, *measured(motion, 0), MASS).fits[law].estimates
    result = {}
    for head, gains in (("rod", (1.01, 1.0)), ("slider", (1.0, 1.01))):
        moved = identify(program, *measured(motion, 0, gains), MASS).fits[law].estimates
        result[head] = {
            name: moved[name].value / one.value - 1.0
            for name, one in base.items()
            if name != "zero_speed_force"
        }
    return result


def explore(program, name, seeds):
    motion = true_motion(program, BEYOND[name])
    return [describe(identify(program, *measured(motion, seed), MASS)) for seed in range(seeds)]


def describe(found):
    more = found.break_away
    result = {
        "chosen": found.chosen or None,
        "reason": found.reason,
        "warnings": list(found.warnings),
        "break_away": None if more.force is None else more.force.value,
        "bracket": [more.highest_sticking, more.lowest_slipping],
    }
    if not found.reason:
        result["line"] = values_of(found.fits["velocity"])
        result[found.chosen] = values_of(found.fit)
    return result


def values_of(fit):
    return {name: [one.value, one.low, one.high] for name, one in fit.estimates.items()}


def show(name, result):
    print(f"\n{name}: law chosen in {result['chosen']} of {result['seeds']}")
    print(f"{'':20s}{'largest error':>15s}{'mean error':>12s}{'deviation':>12s}{'hold':>7s}")
    for key, one in result.items():
        if isinstance(one, dict) and "largest_error" in one:
            numbers = [100.0 * one[k] for k in ("largest_error", "mean_error", "deviation")]
            print(
                f"{key:20s}{numbers[0]:13.3f} %{numbers[1]:+10.3f} %{numbers[2]:10.3f} %"
                f"{one['intervals_that_hold']:7d}"
            )
    for head, changes in result["calibration"].items():
        parts = [f"{key} {100.0 * change:+.3f} %" for key, change in changes.items()]
        print(f"+1 % in the {head}'s head: {', '.join(parts)}")
    print(f"runs with warnings: {result['warnings']}")


def show_beyond(name, results):
    print(f"\n{name}")
    for one in results:
        if one["reason"]:
            print(f"  no law: {one['reason']}")
        else:
            law = one[one["chosen"]]
            parts = [
                f"{key} {v[0]:.4g} [{v[1]:.4g}, {v[2]:.4g}]"
                for key, v in law.items()
                if key != "zero_speed_force"
            ]
            print(f"  {one['chosen']}: {', '.join(parts)}")
        held, slipped = one["bracket"]
        force = "-" if one["break_away"] is None else f"{one['break_away']:.4g} N"
        print(f"  break-away {force}, held {held:.3g} N, slipped at {slipped:.3g} N")
        for text in one["warnings"]:
            print(f"  warning: {text}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--part", choices=("validated", "beyond"))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    begin = time.perf_counter()
    program = find_program()
    content = {"validated": {}, "beyond": {}}
    for name in VALIDATED if options.part != "beyond" else ():
        content["validated"][name] = validate(program, name, options.seeds)
        if not options.json:
            show(name, content["validated"][name])
    for name in BEYOND if options.part != "validated" else ():
        few = max(1, min(3, options.seeds // 10))
        content["beyond"][name] = explore(program, name, few)
        if not options.json:
            show_beyond(name, content["beyond"][name])
    content["seconds"] = time.perf_counter() - begin
    if options.json:
        print(json.dumps(content))
    else:
        print(f"\n{content['seconds']:.0f} s")


if __name__ == "__main__":
    main()
