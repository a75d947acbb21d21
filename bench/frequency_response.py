"""
How well the measured frequency response meets the motor's true one, by either method.

Run: python bench/frequency_response.py [--seeds 10] [--points 40] [--motors paper small_stack]

With hysteresis a motor has no response of its own: what a frequency gets depends on the whole
signal. What a measurement is compared with is therefore

* stepped sine: for a sine of the amplitude used at that frequency, in closed form: the
  describing function of the hysteresis times the response of the modes;
* multisine: the linear response nearest to what truly happened in that very run, from the
  stator's true voltage and the rod's true velocity by the same least squares.

Both from the voltage at the stator to the rod. The gain errors of vibrometer and voltage monitor,
1 % and 0.5 %, which no measurement sees, are taken out of "rest" and stay in "all". Only
frequencies with a coherence above 0.99 count; how many that are is printed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import yaml

from imotor_ros.core.channel import ROD_VELOCITY, VOLTAGE, ChannelDescription
from imotor_ros.core.drive_setting import DriveSetting
from imotor_ros.core.monitor import Monitor
from imotor_ros.core.motor import MotorParameters, VirtualMotor
from imotor_ros.core.response import MeasuredResponse
from imotor_ros.core.response_measurement import ResponseParameters, measure_response
from imotor_ros.core.stator import Stator
from imotor_ros.core.trial import Recording, Trial, carry_out
from imotor_ros.core.vibrometer import Vibrometer, VibrometerParameters

MOTORS = ("paper", "small_stack")
METHODS = ("stepped_sine", "multisine")
RATE = 1e6
GOOD = 0.99


class Stand:
    """A motor with its voltage monitor, and a vibrometer at its rod."""

    def __init__(self, name: str, seed: int) -> None:
        path = Path(__file__).parents[1] / "params" / "motors" / f"{name}.yaml"
        text = path.read_text(encoding="utf-8")
        self.motor = MotorParameters.from_mapping(yaml.safe_load(text), name)
        self.seed = seed
        self.truth: list[Recording] = []

    @property
    def setting(self) -> DriveSetting:
        limits = self.motor.drive_limits
        middle = 0.5 * (limits.lowest_voltage + limits.highest_voltage)
        return DriveSetting("bench", 0, RATE, middle, 5e-3, limits)

    @property
    def gain(self) -> float:
        """What the instruments make of a gain of 1."""
        head = Vibrometer(VibrometerParameters(), RATE, self.seed, ROD_VELOCITY)
        return head.gain / Monitor(self.motor.voltage_monitor, RATE, self.seed).gain

    def play(self, trial: Trial) -> Recording:
        """Play a trial; note what truly happened."""
        program = trial.program
        motor = VirtualMotor(self.motor, RATE, self.seed)
        head = Vibrometer(VibrometerParameters(), RATE, self.seed, ROD_VELOCITY)
        moved = motor.process(program.render(0, program.length))
        velocity, flags = head.process(moved.rod_velocity)
        ideal = {
            # the same ranges, for they decide on amplitudes
            ROD_VELOCITY: ChannelDescription(ROD_VELOCITY, "velocity", "m/s", head.channel.range),
            VOLTAGE: ChannelDescription(VOLTAGE, "voltage", "V", motor.channels[0].range),
        }
        truth = {ROD_VELOCITY: moved.rod_velocity, VOLTAGE: moved.stator_voltage}
        self.truth.append(Recording(program, truth, ideal))
        return Recording(
            program,
            {ROD_VELOCITY: velocity, VOLTAGE: moved.voltage_monitor},
            {ROD_VELOCITY: head.channel, VOLTAGE: motor.channels[0]},
            {ROD_VELOCITY: int(flags), VOLTAGE: int(moved.voltage_monitor_flags)},
        )

    def true_response(self, parameters: ResponseParameters, found: MeasuredResponse) -> np.ndarray:
        """Displacement per volt (m/V) as the module's description defines it."""
        if parameters.method == "stepped_sine":
            return self._sine_response(found)
        procedure = measure_response(self.setting, parameters)
        next(procedure)
        try:
            for recording in self.truth:
                procedure.send(recording)
        except StopIteration as end:
            return np.array(end.value.gains)
        raise AssertionError("the truth has as many trials as the measurement")

    def _sine_response(self, response: MeasuredResponse) -> np.ndarray:
        """Displacement per volt at the stator (m/V) for sines of the amplitudes used."""
        frequencies = np.array(response.frequencies)
        passed = np.abs(self.motor.amplifier.frequency_response(frequencies))
        amplitudes = passed * np.array(response.amplitudes)
        return Stator(self.motor.stator, RATE).sine_response(frequencies, amplitudes)


def try_seed(task: tuple[str, str, int, int]) -> np.ndarray:
    """Return per frequency: magnitude and phase error, the former with calibration, coherence."""
    name, method, points, seed = task
    stand = Stand(name, seed)
    parameters = ResponseParameters(method=method, points=points)
    found = carry_out(measure_response(stand.setting, parameters), stand.play)
    ratio = np.array(found.gains) / stand.true_response(parameters, found)
    rest = ratio / stand.gain
    return np.array(
        [
            found.frequencies,
            np.abs(rest) - 1.0,
            np.degrees(np.angle(rest)),
            np.abs(ratio) - 1.0,
            found.coherences,
        ]
    )


def row(name: str, method: str, results: list[np.ndarray]) -> tuple[str, bool]:
    """Return the line of a motor and a method, and whether it is within 1 % and 1 degree."""
    frequency, rest, phase, everything, coherence = np.concatenate(results, axis=1)
    good = coherence > GOOD
    largest, turned = np.abs(rest)[good].max(), np.abs(phase)[good].max()
    at = frequency[good][np.argmax(np.abs(rest)[good])]
    cells = (
        f"{name:12} {method:13} {good.sum():6} of {len(good):<6} {coherence.min():8.5f} "
        f"{100 * largest:8.3f} {turned:8.3f} {at:9.0f} {100 * np.abs(everything)[good].max():7.2f}"
    )
    return cells, bool(largest <= 0.01 and turned <= 1.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument("--motors", nargs="+", choices=MOTORS, default=MOTORS)
    options = parser.parse_args()
    jobs = len(os.sched_getaffinity(0))
    started = time.perf_counter()
    print(
        f"{'':12} {'':13} {'coherence':>16} {'least':>8} {'rest':>8} {'rest':>8} "
        f"{'at':>9} {'all':>7}\n"
        f"{'motor':12} {'method':13} {'above ' + str(GOOD):>16} {'':8} {'(%)':>8} {'(deg)':>8} "
        f"{'(Hz)':>9} {'(%)':>7}"
    )
    cases = [(name, method) for name in options.motors for method in METHODS]
    tasks = [(*case, options.points, 1 + i) for case in cases for i in range(options.seeds)]
    is_good = True
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("forkserver")) as pool:
        results = pool.map(try_seed, tasks)
        for case in cases:
            line, is_met = row(*case, [next(results) for _ in range(options.seeds)])
            is_good = is_good and is_met
            print(line, flush=True)
    print(
        f"\n{options.seeds} seeds; {'all' if is_good else 'not all'} within 1 % and 1 degree where "
        f"the coherence is above {GOOD}; {time.perf_counter() - started:.0f} s on {jobs} cores"
    )
    return 0 if is_good else 1


if __name__ == "__main__":
    raise SystemExit(main())
