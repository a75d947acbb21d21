"""
The slider in sampled time: the virtual plant's own solver, fed block by block.

Rod velocity and acceleration are given at the samples and make a cubic between them. Within a
sample the slider's motion is a power series, exact for Coulomb friction; events are located
inside the sample, as many as there are. A sample depends on the one before and on nothing else:
however a signal is cut into blocks, the answer is the same to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.flow import constants, series_workspace
from imotor_ros.core.friction import FrictionLaw
from imotor_ros.core.polynomial import root_workspace
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.stepping_kernels import process_samples
from imotor_ros.errors import BadInputError, SolverError

Array = NDArray[np.float64]

# Within a sample a straight law needs few terms; shorter steps make up for fast loads.
_STRAIGHT_ORDER, _CURVED_ORDER = 6, 10


@dataclass(frozen=True)
class SliderState:
    """
    All that the slider remembers from one sample to the next.

    Attributes
    ----------
    position : float
        Slider position (m).
    relative_velocity : float
        Rod minus slider velocity (m/s); exactly 0 while sticking.
    mode : int
        0 sticking, else the sign of the relative velocity.
    stop : int
        0 away from the end stops; 1 pushing against one, 2 retreating from it without force;
        negative at the lower stop.
    rod_velocity, rod_acceleration : float
        Rod motion at the last sample (m/s, m/s^2).
    axial_force : float
        Outer axial force at the last sample (N), beside the constant one.
    normal_force : float
        Outer normal force at the last sample (N), beside the constant one.

    """

    position: float = 0.0
    relative_velocity: float = 0.0
    mode: int = 0
    stop: int = 0
    rod_velocity: float = 0.0
    rod_acceleration: float = 0.0
    axial_force: float = 0.0
    normal_force: float = 0.0


@dataclass(frozen=True)
class SliderResponse:
    """
    The slider at the sample instants; arrays of shape (samples,).

    Attributes
    ----------
    position, velocity : ndarray
        Of the slider (m, m/s).
    load_force : ndarray
        Force of spring, weight and end stops (N), positive along -x.
    friction_force : ndarray
        Force of the rod on the slider (N), positive along +x.
    is_sticking : ndarray of bool
        Whether it sticks.

    """

    position: Array
    velocity: Array
    load_force: Array
    friction_force: Array
    is_sticking: NDArray[np.bool_]


class SliderStepper:
    """
    Moves the slider along with a sampled rod motion.

    Parameters
    ----------
    slider : SliderParameters
        Mass, inclination, constant outer forces.
    load : LoadParameters
        Spring, weight, end stops.
    friction : FrictionLaw
        Friction law at the nominal contact force.
    sample_rate : float
        Samples per second (Hz).
    position, velocity : float
        Of the slider at the first sample (m, m/s).

    Raises
    ------
    BadInputError
        If the sample rate or the start is not a usable number.

    """

    def __init__(
        self,
        slider: SliderParameters,
        load: LoadParameters,
        friction: FrictionLaw,
        sample_rate: float,
        *,
        position: float = 0.0,
        velocity: float = 0.0,
    ) -> None:
        if not (math.isfinite(sample_rate) and sample_rate > 0.0):
            raise BadInputError(
                "is out of bounds",
                where="sample_rate",
                value=sample_rate,
                bound="> 0 Hz",
            )
        for name, value in (("position", position), ("velocity", velocity)):
            if not math.isfinite(value):
                raise BadInputError("is not finite", where=name, value=value)
        self.slider, self.load, self.friction = slider, load, friction
        self.sample_rate = float(sample_rate)
        self._constants = constants(slider.mass, friction.numbers, load.numbers)
        self._start = (float(position), float(velocity))
        self._state: SliderState | None = None
        order = _CURVED_ORDER if friction.numbers.excess else _STRAIGHT_ORDER
        self._series = series_workspace(order, slider.mass)
        self._roots = root_workspace()

    @property
    def state(self) -> SliderState | None:
        """State at the last sample; None before the first. Assign one to go on from there."""
        return self._state

    @state.setter
    def state(self, state: SliderState | None) -> None:
        self._state = state

    def reset(self) -> None:
        """Go back to the start."""
        self._state = None

    def process(
        self,
        rod_velocity: ArrayLike,
        rod_acceleration: ArrayLike,
        axial_force: ArrayLike | None = None,
        normal_force: ArrayLike | None = None,
    ) -> SliderResponse:
        """
        Take the next samples of the rod motion and return the slider's.

        Parameters
        ----------
        rod_velocity, rod_acceleration : array_like, shape (samples,)
            Rod motion at the samples (m/s, m/s^2).
        axial_force, normal_force : array_like, shape (samples,), optional
            Outer forces on the slider (N), along +x and onto the rod, in addition to the constant
            ones of the parameters; linear between samples. A normal force that lifts the slider
            leaves no friction.

        Returns
        -------
        SliderResponse
            At the same samples. The first sample ever is the start itself.

        Raises
        ------
        BadInputError
            If the arrays differ in shape or hold a number that is not finite.
        SolverError
            If events pile up inside one sample.

        """
        velocity = _samples(rod_velocity, None, "rod_velocity")
        acceleration = _samples(rod_acceleration, velocity, "rod_acceleration")
        axial = _samples(axial_force, velocity, "axial_force")
        normal = _samples(normal_force, velocity, "normal_force")
        count = velocity.size
        position, slider_velocity = np.empty(count), np.empty(count)
        load, friction = np.empty(count), np.empty(count)
        is_sticking = np.empty(count, dtype=np.bool_)
        response = SliderResponse(position, slider_velocity, load, friction, is_sticking)
        if count == 0:
            return response
        has_started = self._state is not None
        state = self._state or SliderState()
        memory = np.array(
            [state.position, state.relative_velocity, state.mode, state.stop, state.rod_velocity,
             state.rod_acceleration, state.axial_force, state.normal_force]
        )  # fmt: skip
        if not has_started:
            memory[:2] = self._start
        slider = self.slider
        failed = process_samples(
            velocity, acceleration, axial, normal, has_started, memory, 1.0 / self.sample_rate,
            slider.axial_force - slider.weight_along_rod,
            slider.friction_scale, 1.0 / slider.nominal_contact_force,
            self._constants, self._series, self._roots,
            position, slider_velocity, load, friction, is_sticking,
        )  # fmt: skip
        if failed >= 0:
            raise SolverError(f"events pile up before sample {failed} of the block")
        x, w, mode, stop, *rest = memory.tolist()
        self._state = SliderState(x, w, int(mode), int(stop), *rest)
        return response


_NO_SAMPLES = np.empty(0)


def _samples(values: ArrayLike | None, like: Array | None, where: str) -> Array:
    if values is None:
        return _NO_SAMPLES
    array = np.ascontiguousarray(values, dtype=np.float64)
    if not array.flags.writeable:
        # A view of a message: another type to the compiler, which would compile all over again.
        array = array.copy()
    if array.ndim != 1 or (like is not None and array.shape != like.shape):
        bound = "one dimension" if like is None else f"shape {like.shape}"
        raise BadInputError("has the wrong shape", where=where, value=array.shape, bound=bound)
    if not np.all(np.isfinite(array)):
        raise BadInputError("holds a number that is not finite", where=where)
    return array
