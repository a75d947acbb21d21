"""From the wanted motion to the voltage: the correction, its limits and its refusals."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from imotor_ros.core.channel import ChannelDescription
from imotor_ros.core.correction import CorrectionParameters, Excitation, correct_excitation
from imotor_ros.core.correction_search import Broyden
from imotor_ros.core.drive_limits import program_demand
from imotor_ros.core.harmonic_fit import fit_harmonics
from imotor_ros.core.motor import MotorParameters
from imotor_ros.core.signals import HarmonicMotion, parabolic_sawtooth, sine
from imotor_ros.core.stator import StatorParameters
from imotor_ros.core.trial import carry_out
from imotor_ros.core.vibrometer import VibrometerParameters
from imotor_ros.errors import BadInputError, DriveLimitError, ExcitationError

MakeRig = Callable[..., Any]
PAPER_ALONE = CorrectionParameters(suppressed_harmonics=0)


def correct(
    rig: Any, motion: HarmonicMotion, parameters: CorrectionParameters | None = None, **options: Any
) -> Excitation:
    procedure = correct_excitation(
        rig.setting, motion, parameters or CorrectionParameters(), **options
    )
    return carry_out(procedure, rig.play)


def true_errors(
    rig: Any, motion: HarmonicMotion, settling_time: float = 8e-3
) -> tuple[float, float]:
    """Return the errors of the rod's true motion in the last trial, calibration taken off."""
    trial, truth = rig.played[-1]
    fit = fit_harmonics(
        truth.rod_velocity * rig.calibration[0],
        ChannelDescription("rod/velocity", "velocity", "m/s", 1.0),
        trial.program,
        "hold",
        settling_time=settling_time,
        count=motion.harmonics,
    )
    orders = np.arange(1, motion.harmonics + 1)
    moved = fit.phasors / (2j * np.pi * motion.fundamental_frequency * orders)
    ratio = moved / (np.array(motion.amplitudes) * np.exp(1j * np.array(motion.phases)))
    relative = np.angle(ratio * np.exp(-1j * orders * np.angle(ratio[0])))
    return float(np.abs(np.abs(ratio) - 1.0).max()), float(np.abs(relative).max())


@pytest.mark.parametrize("motor", ["paper", "small_stack"])
@pytest.mark.parametrize(
    ("harmonics", "maximum_frequency"), [(2, 18500.0), (3, 9250.0), (4, 2312.5), (4, 18500.0)]
)
def test_motion_is_reached_in_three_cycles(
    make_rig: MakeRig, motor: str, harmonics: int, maximum_frequency: float
) -> None:
    """A sample of the grid of figure 12; bench/excitation.py does all of it, with many seeds."""
    motion = parabolic_sawtooth(harmonics, maximum_frequency=maximum_frequency)
    rig = make_rig(motor, seed=harmonics)
    found = correct(rig, motion)
    assert found.cycles <= 3
    assert max(map(abs, found.amplitude_errors)) < 0.01
    assert max(map(abs, found.phase_errors)) < math.radians(1.0)
    assert found.largest_amplitude_errors[0] > 0.01 or found.largest_phase_errors[0] > 0.02
    amplitude, phase = true_errors(rig, motion)
    assert amplitude < 0.01
    assert phase < math.radians(1.0)


def test_table_1_comes_out(make_rig: MakeRig) -> None:
    """
    Voltages of the linear model and after iteration, cosine phases relative to the first.

    Calibration, 1 %, is in all amplitudes; how hysteresis spoils the motion was fitted roughly.
    """
    motion = parabolic_sawtooth(4, fundamental_frequency=4625.0)
    perfect = VibrometerParameters(calibration_uncertainty=0.0)
    found = correct(make_rig("paper", vibrometer=perfect), motion, PAPER_ALONE)
    assert found.linear_amplitudes == pytest.approx((37.44, 13.98, 5.75, 2.05), rel=0.02)
    assert found.amplitudes == pytest.approx((36.87, 14.09, 5.76, 1.97), rel=0.05)
    for phases, printed, bound in (
        (found.linear_phases, (-73.1, -152.1, 126.1), 2.5),
        (found.phases, (-75.1, -150.1, 140.5), 5.0),
    ):
        orders = np.arange(1, 5)
        cosine = np.array(phases) - np.pi / 2
        relative = np.degrees(np.angle(np.exp(1j * (cosine - orders * cosine[0]))))
        assert relative[1:] == pytest.approx(printed, abs=bound)


def test_linear_motor_needs_no_correction(make_rig: MakeRig) -> None:
    rig = make_rig(MotorParameters(stator=StatorParameters.linear()))
    found = correct(rig, parabolic_sawtooth(3, maximum_frequency=9250.0))
    assert found.cycles == 0
    assert found.amplitudes[:3] == pytest.approx(found.linear_amplitudes)
    assert found.largest_amplitude_errors[0] < 2e-3


def test_uncorrected_excitation_is_that_of_the_linear_model(make_rig: MakeRig) -> None:
    rig = make_rig("paper")
    motion = parabolic_sawtooth(4, maximum_frequency=18500.0)
    found = correct(rig, motion, is_corrected=False)
    assert found.amplitudes == found.linear_amplitudes
    assert found.phases == found.linear_phases
    assert found.cycles == 0
    assert found.largest_amplitude_errors[0] > 0.05


def test_unwanted_harmonics_are_brought_to_rest(make_rig: MakeRig) -> None:
    """n = 2, 18.5 kHz: the fourth harmonic, which hysteresis makes, meets the mode at 36 kHz."""
    motion = parabolic_sawtooth(2, maximum_frequency=18500.0)
    with_it, without = make_rig("paper"), make_rig("paper")
    quiet = correct(with_it, motion)
    correct(without, motion, PAPER_ALONE)
    assert len(quiet.amplitudes) == 6
    assert max(quiet.unwanted_velocities) < 0.05
    residuals = []
    for rig in (with_it, without):
        trial, truth = rig.played[-1]
        start, end = trial.program.span("hold")
        middle = np.arange(start + 10_000, end - 1000)
        turns = trial.program.cycles("hold", middle.astype(float))
        wanted = motion.velocity(turns / motion.fundamental_frequency)
        residuals.append(np.std(truth.rod_velocity[middle] - wanted) / np.std(wanted))
    assert residuals[0] < 0.1
    assert residuals[1] > 3.0 * residuals[0]


def test_search_repeats_to_the_last_bit(make_rig: MakeRig) -> None:
    motion = parabolic_sawtooth(2, maximum_frequency=9250.0)
    assert correct(make_rig("paper"), motion) == correct(make_rig("paper"), motion)


def test_excitation_round_trips_through_a_mapping(make_rig: MakeRig) -> None:
    found = correct(make_rig("paper"), sine(2e-6, 4625.0))
    assert Excitation.from_mapping(found.to_mapping()) == found


def test_every_trial_stays_in_the_range_and_its_ends_are_ramps(make_rig: MakeRig) -> None:
    rig = make_rig("small_stack")
    correct(rig, parabolic_sawtooth(4, maximum_frequency=18500.0))
    assert len(rig.played) >= 4
    for trial, _ in rig.played:
        voltage = trial.program.render(0, trial.program.length)
        assert voltage[0] == 0.0
        assert abs(voltage[-1]) < 0.1
        assert voltage.min() >= -30.0
        assert voltage.max() <= 150.0
        assert np.abs(np.diff(voltage)).max() * 1e6 <= program_demand(trial.program).slope * 1.01


# ---- refusals --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "quantity", "allowed"),
    [
        ({"highest_voltage": 95.0}, "voltage", 95.0),
        ({"slew_rate": 2e6}, "slew rate", 2e6),
        ({"current_limit": 3.0}, "current", 3.0),
    ],
)
def test_motion_beyond_the_limits_is_refused(
    make_rig: MakeRig, change: dict[str, float], quantity: str, allowed: float
) -> None:
    """With the needed and the allowed value, before a sample of it leaves."""
    motor = MotorParameters()
    rig = make_rig(motor.replace(amplifier=motor.amplifier.replace(**change)))
    stroke = 21e-6 if quantity == "voltage" else 15e-6
    motion = parabolic_sawtooth(2, stroke, maximum_frequency=18500.0)
    with pytest.raises(DriveLimitError) as caught:
        correct(rig, motion)
    assert caught.value.quantity == quantity
    assert caught.value.allowed == allowed
    assert abs(caught.value.needed - allowed) > 0.01 * abs(allowed)
    assert isinstance(caught.value, BadInputError)
    for trial, truth in rig.played:
        rig.motor.drive_limits.check_program(trial.program)
        assert not truth.flags


def test_motion_beyond_the_vibrometer_is_refused(make_rig: MakeRig) -> None:
    rig = make_rig("paper", vibrometer=VibrometerParameters(velocity_range=0.025))
    with pytest.raises(DriveLimitError, match=r"velocity of 0\.5886 m/s.*at most 0\.25 m/s"):
        correct(rig, parabolic_sawtooth(2, maximum_frequency=18500.0))


def test_response_that_cannot_be_told_from_noise_is_refused(make_rig: MakeRig) -> None:
    deaf = VibrometerParameters(noise_density=1e-3, velocity_range=1.0)
    settings = CorrectionParameters(response_amplitude=1.0, measuring_time=1e-3)
    with pytest.raises(ExcitationError, match="cannot be told from noise"):
        correct(make_rig("paper", vibrometer=deaf), sine(1e-6, 1000.0), settings)


def test_motion_that_noise_hides_is_refused_with_the_reason(make_rig: MakeRig) -> None:
    """The errors come down to the noise, 1 %, and no further."""
    loud = VibrometerParameters(noise_density=1e-4, velocity_range=0.5)
    motion = parabolic_sawtooth(4, 3e-6, maximum_frequency=2312.5)
    with pytest.raises(ExcitationError, match=r"harmonic \d.*uncertain by .* %"):
        correct(make_rig("paper", vibrometer=loud), motion)


@pytest.mark.parametrize(
    ("harmonic", "damping_ratio", "reason"),
    [
        # the other harmonics are far above the resonance, where the rod hardly follows
        (1, 0.05, r"needs a voltage of -\d+\.\d+ V, expected at least -20 V"),
        (1, 0.02, r"needs a voltage of -\d+\.\d+ V, expected at least -20 V"),
        (2, 0.05, ""),
        (2, 0.01, ""),
        (2, 0.003, ""),
        (3, 0.05, ""),
        (3, 0.01, ""),
        # a small error of the voltage, and the rod moves faster than the vibrometer can show
        (3, 0.003, r"rod/velocity: cannot be used, got 'over range'"),
    ],
)
def test_resonance_at_a_harmonic_converges_or_is_refused_with_the_reason(
    make_rig: MakeRig, harmonic: int, damping_ratio: float, reason: str
) -> None:
    """Right at it, the phase turns by 90 degrees within the damping ratio of its frequency."""
    stator = StatorParameters().replace(
        resonance_frequency=harmonic * 4625.0, damping_ratio=damping_ratio, second_mode_share=0.0
    )
    rig = make_rig(MotorParameters(stator=stator))
    motion = parabolic_sawtooth(3, fundamental_frequency=4625.0)
    # three time constants 1 / (2 pi f zeta) of the mode and more
    settling_time = 30e-3 if damping_ratio < 0.01 else 10e-3
    settings = CorrectionParameters(settling_time=settling_time)
    if reason:
        with pytest.raises((ExcitationError, DriveLimitError), match=reason):
            correct(rig, motion, settings)
        return
    found = correct(rig, motion, settings)
    assert max(map(abs, found.amplitude_errors)) < 0.01
    assert max(map(abs, found.phase_errors)) < math.radians(1.0)
    amplitude, phase = true_errors(rig, motion, settling_time)
    assert amplitude < 0.01
    assert phase < math.radians(1.0)


def test_search_for_what_does_not_answer_ends_with_the_reason(make_rig: MakeRig) -> None:
    rig = make_rig("paper")
    settings = CorrectionParameters(cycle_limit=0)
    with pytest.raises(ExcitationError, match="after 0 corrections harmonic"):
        correct(rig, parabolic_sawtooth(3, maximum_frequency=9250.0), settings)


# ---- Broyden's method ------------------------------------------------------------------------


def test_broyden_solves_a_coupled_system_whose_slopes_were_guessed() -> None:
    """y = (1 + 0.3i) G u + coupling: 2m unknowns take at most 4m steps (Gay's theorem)."""
    gains = np.array([1e-7 + 1e-8j, 2e-7j])
    mixing = np.array([[1.0 + 0.3j, 0.2], [-0.1j, 0.8]])

    def move(voltage: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return mixing @ (gains * voltage) + np.array([1e-7, -2e-7j])

    wanted = np.array([5e-6, 2e-6j])
    voltage, steps = wanted / gains, Broyden(gains)
    for _ in range(8):
        voltage = steps.next_voltage(voltage, move(voltage), wanted)
    assert move(voltage) == pytest.approx(wanted, rel=1e-9)
