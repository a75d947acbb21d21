"""
Cost of each stage of the virtual stand, in nanoseconds per sample and against the slider's.

Run as `python bench/stand.py [SECONDS_OF_STREAM]`. All stages take the same run, the parabolic
sawtooth with two harmonics at 9250 Hz, 15 um, in blocks of 10 000 samples at 1 MS/s; the best of
three rounds counts, rounds of all stages taking turns. The ratios are those to the slider without
load; the whole motor has the stops of the stand and reaches one after 0.15 s. "amplifier and
stator" is the way from the wanted voltage to the rod, hysteresis and current included.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core.amplifier import Amplifier
from imotor_ros.core.channel import ROD_VELOCITY, SLIDER_VELOCITY
from imotor_ros.core.drive import DriveProgram, steady_drive
from imotor_ros.core.excitation import voltage_for_motion
from imotor_ros.core.force_sensor import ForceSensor
from imotor_ros.core.monitor import Monitor
from imotor_ros.core.motor import VirtualMotor
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.slider import LoadParameters
from imotor_ros.core.stand import StandParameters
from imotor_ros.core.stator import Stator
from imotor_ros.core.stepping import SliderStepper
from imotor_ros.core.vibrometer import Vibrometer

Array = NDArray[np.float64]
Inputs = Sequence[tuple[Array, ...]]
ROUNDS = 3


def program(stand: StandParameters, seconds: float) -> DriveProgram:
    motion = parabolic_sawtooth(2, fundamental_frequency=9250.0)
    motor = VirtualMotor(stand.motor, stand.sample_rate, 1)
    amplitudes, phases = voltage_for_motion(motion, motor.displacement_response)
    return steady_drive(
        run_id="bench",
        epoch=0,
        sample_rate=stand.sample_rate,
        fundamental_frequency=motion.fundamental_frequency,
        offset=50.0,
        amplitudes=amplitudes,
        phases=phases,
        hold_time=seconds,
    )


def stages(stand: StandParameters, seconds: float) -> dict[str, tuple[Callable[[], Any], Inputs]]:
    """Return, by name, what makes each stage's `process`, and the blocks it takes."""
    rate, motor = stand.sample_rate, stand.motor
    run = program(stand, seconds)
    starts = range(0, run.length - stand.block_length, stand.block_length)
    voltage = [run.render(start, stand.block_length) for start in starts]
    whole = VirtualMotor(motor, rate, 1)
    truth = [whole.process(block) for block in voltage]
    rods = [Stator(motor.stator, rate).process(response.stator_voltage) for response in truth]
    moving = [(rod.velocity, rod.acceleration) for rod in rods]
    far_stops = motor.load.replace(lower_stop=-1.0, upper_stop=1.0)
    near_stops = motor.load.replace(upper_stop=1e-4)
    capacitance = motor.stator.largest_capacitance

    def make_rod() -> Callable[..., Any]:
        amplifier = Amplifier(motor.amplifier, rate, load_capacitance=capacitance)
        stator = Stator(motor.stator, rate)
        return lambda block: stator.process(amplifier.process(block)[0])

    def instrument(make: Callable[..., Any], *arguments: Any, **options: Any) -> Callable[[], Any]:
        return lambda: make(*arguments, **options).process

    return {
        "slider": (
            instrument(SliderStepper, motor.slider, LoadParameters.free(), motor.friction, rate),
            moving,
        ),
        "slider between stops": (
            instrument(SliderStepper, motor.slider, far_stops, motor.friction, rate),
            moving,
        ),
        "slider at a stop": (
            instrument(SliderStepper, motor.slider, near_stops, motor.friction, rate),
            moving,
        ),
        "amplifier": (
            instrument(Amplifier, motor.amplifier, rate, load_capacitance=capacitance),
            [(block,) for block in voltage],
        ),
        "stator": (
            instrument(Stator, motor.stator, rate),
            [(response.stator_voltage,) for response in truth],
        ),
        "amplifier and stator": (make_rod, [(block,) for block in voltage]),
        "voltage monitor": (
            instrument(Monitor, motor.voltage_monitor, rate, 1),
            [(response.stator_voltage,) for response in truth],
        ),
        "current monitor": (
            instrument(Monitor, motor.current_monitor, rate, 1),
            [(response.stator_current,) for response in truth],
        ),
        "whole motor": (
            instrument(VirtualMotor, motor, rate, 1),
            [(block,) for block in voltage],
        ),
        "rod vibrometer": (
            instrument(Vibrometer, stand.rod_vibrometer, rate, 1, ROD_VELOCITY),
            [(response.rod_velocity,) for response in truth],
        ),
        "slider vibrometer": (
            instrument(Vibrometer, stand.slider_vibrometer, rate, 1, SLIDER_VELOCITY),
            [(response.slider_velocity,) for response in truth],
        ),
        "force sensor": (
            instrument(ForceSensor, stand.force_sensor, rate, 1),
            [(response.load_force,) for response in truth],
        ),
    }


def cost(make: Callable[[], Any], inputs: Inputs) -> float:
    """Return nanoseconds per sample of one round."""
    process = make()
    start = time.perf_counter()
    for block in inputs:
        process(*block)
    return (time.perf_counter() - start) * 1e9 / sum(len(block[0]) for block in inputs)


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    measured = stages(StandParameters(), seconds)
    costs = {name: [] for name in measured}
    for _ in range(ROUNDS):
        for name, (make, inputs) in measured.items():
            costs[name].append(cost(make, inputs))
    reference = min(costs["slider"])
    print(f"{'stage':22}{'ns/sample':>12}{'of slider':>12}{'x real time':>14}")
    for name, values in costs.items():
        best = min(values)
        speed = 1e9 / best / StandParameters().sample_rate
        print(f"{name:22}{best:12.1f}{best / reference:12.2f}{speed:14.1f}")


if __name__ == "__main__":
    main()
