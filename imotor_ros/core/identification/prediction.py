"""What a friction law predicts for a step: the slider driven by the measured rod motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imotor_ros.core import closed_form, taylor
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.identification.break_away import rod_motion
from imotor_ros.core.identification.steps import StepMeasurement
from imotor_ros.core.slider import SliderParameters

Array = NDArray[np.float64]

_PERIODS = 30


def predict_slider(
    measurement: StepMeasurement, friction: FrictionLaw, mass: float, frequency: float, phase: Array
) -> Array:
    """
    Return the slider velocity (m/s) in the settled state.

    Parameters
    ----------
    measurement : StepMeasurement
        The step.
    friction : FrictionLaw
        The law.
    mass, frequency : float
        Of the slider (kg), of the drive (Hz).
    phase : ndarray, shape (n,)
        Phases (rad) from 0 to 2 pi, as those of the measurement's phasors.

    Raises
    ------
    SolverError
        If the solver cannot go on.

    """
    solver = closed_form if closed_form.applies(friction) else taylor
    motion, slider = rod_motion(measurement, frequency), SliderParameters(mass=mass)
    table = solver.simulate(motion, slider, friction, periods=_PERIODS, record=True)
    assert table.trajectory is not None
    turns = _PERIODS - 1 + np.clip(phase / (2.0 * np.pi), 0.0, 1.0)
    return np.asarray(table.trajectory.sample(turns * motion.period).velocity)
