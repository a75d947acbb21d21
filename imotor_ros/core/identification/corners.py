"""
A periodic velocity with corners, reconstructed from its first harmonics.

The slider's acceleration jumps where the relative velocity changes sign: its velocity has a
corner there, a triangle under Coulomb friction. Harmonics cut off at some order make every
corner round and its tip too low (by 0.4 / K of the amplitude after K harmonics of a triangle), and
differentiating them amplifies noise. So the part that the harmonics lack is modelled. A jump J of
the acceleration and a jump J' of its slope at phase theta_0 have, in the velocity, the harmonics

    J exp(-i k theta_0) / (i k)^2   and   J' exp(-i k theta_0) / (i k)^3

but for factors, to all orders; what is smooth fades faster. The model is therefore: free
harmonics up to a low order, plus jumps of both kinds at the corners. Its sums are Bernoulli
polynomials, so that it is exact at the corners. Harmonics that it leaves over and that are more
than noise are added to it as they are.

Two corners and their jumps are fitted (`fit_corners`). Where a distorted rod motion overtakes
the slider more than twice per period, corners too close to be told apart are put where the
relative velocity changes sign, with one jump for all, there and back (`fit_crossings`).

Under Coulomb friction the model is exact; under a force that depends smoothly on the relative
velocity, the next kind of jump is left out, which is small. See `docs/friction_identification.md`
for the errors that were measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imotor_ros.core.phases import trigonometric_value

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

TURN = 2.0 * math.pi

_KINDS = 2  # jumps of the acceleration, and of its slope
_START_COUNT = 24
_MOST_STEPS = 12
_LONGEST_STEP = 0.1
_SIGNIFICANT = 4.0
_GRID = TURN * np.arange(1024) / 1024.0


def _corner_value(order: int, phase: Array) -> Array:
    """
    Return the sum over k != 0 of exp(i k phase) / (i k)^order, order 1 to 3.

    Where order 1 jumps, at phase 0, the value after the jump is returned.
    """
    x = np.mod(phase / TURN, 1.0)
    if order == 1:
        return np.asarray(-TURN * (x - 0.5))
    if order == 2:
        return np.asarray(-(TURN**2) / 2.0 * (x * x - x + 1.0 / 6.0))
    return np.asarray(-(TURN**3) / 6.0 * x * (x - 0.5) * (x - 1.0))


@dataclass(frozen=True)
class TurningPoint:
    """
    Where the velocity is largest or smallest among its neighbours.

    Attributes
    ----------
    phase, value : float
        Where (rad), and the velocity there (m/s).
    corner : int
        Which corner it is, or -1.
    sign : int
        +1 for a largest, -1 for a smallest value.

    """

    phase: float
    value: float
    corner: int
    sign: int


@dataclass(frozen=True)
class CornerWaveform:
    """
    A velocity over one period, as fitted.

    Attributes
    ----------
    smooth : ndarray of complex, shape (n,)
        Phasors (m/s) of the smooth part: the free harmonics, and those left over.
    corners : ndarray, shape (m,)
        Phases (rad) of the corners.
    jumps : ndarray, shape (m, 2)
        Weight (m/s) of the jump of the acceleration and of that of its slope at each corner.
    jacobian : ndarray, shape (values, fitted)
        Derivatives of the phasors, over their noise, by what was fitted.
    spread : ndarray, shape (parameters, fitted)
        How the parameters follow from what was fitted: real and imaginary parts of `smooth` in
        turn, `jumps`, `corners`.
    chi_square, freedom : float, int
        Sum of squared residuals over the noise, before any are added, and degrees of freedom.

    """

    smooth: Complex
    corners: Array
    jumps: Array
    jacobian: Array
    spread: Array
    chi_square: float
    freedom: int

    @cached_property
    def covariance(self) -> Array:
        """Covariance of real and imaginary parts of `smooth` in turn, of `jumps`, of `corners`."""
        return np.asarray(self.spread @ _covariance(self.jacobian) @ self.spread.T)

    @property
    def misfit(self) -> float:
        """Chi square per degree of freedom."""
        return self.chi_square / max(self.freedom, 1)

    @property
    def slope_jumps(self) -> Array:
        """By how much the derivative by the phase jumps at each corner (m/s), shape (m,)."""
        return np.asarray(TURN * self.jumps[:, 0])

    def velocity(self, phase: ArrayLike) -> Array:
        """Return the velocity (m/s), mean left out, at phases (rad)."""
        phases = np.asarray(phase, dtype=np.float64)
        total = trigonometric_value(self.smooth, phases)
        for corner, jumps in zip(self.corners, self.jumps, strict=True):
            for kind, jump in enumerate(jumps):
                total = total + jump * _corner_value(kind + 2, phases - corner)
        return np.asarray(total)

    @property
    def turning_points(self) -> tuple[TurningPoint, ...]:
        """Highest and lowest points in turn, as they follow each other in a period."""
        phases = np.concatenate([_GRID, np.mod(self.corners, TURN)])
        order = np.argsort(phases, kind="stable")
        phases = phases[order]
        values = self.velocity(phases)
        # a grid point that coincides with a corner would be a flat piece
        is_new = values != np.roll(values, 1)
        phases, values, order = phases[is_new], values[is_new], order[is_new]
        rise = np.sign(np.roll(values, -1) - values)
        turns = np.flatnonzero(rise != np.roll(rise, 1))
        return tuple(
            TurningPoint(
                float(phases[i]),
                float(values[i]),
                max(int(order[i]) - _GRID.size, -1),
                -int(rise[i]),
            )
            for i in turns
        )

    @property
    def total_variation(self) -> float:
        """How far the velocity goes up and down in a period (m/s)."""
        return 2.0 * sum(point.sign * point.value for point in self.turning_points)

    @property
    def total_variation_noise(self) -> float:
        """Standard deviation of `total_variation` (m/s), from the covariance."""
        gradient = sum(2.0 * one.sign * self._gradient(one) for one in self.turning_points)
        variance = float(np.dot(gradient, self.covariance @ gradient))
        return math.sqrt(max(variance, 0.0))

    def _gradient(self, point: TurningPoint) -> Array:
        """Return the derivative of the velocity at a point, which a corner takes along."""
        phase = np.array([point.phase])
        turns = np.exp(1j * phase[0] * np.arange(1, self.smooth.size + 1))
        parts = np.column_stack([turns.real, -turns.imag]).ravel()
        own = [_corner_value(k + 2, phase - c) for c in self.corners for k in range(_KINDS)]
        moved = [-self._own_slope(j, phase) for j in range(self.corners.size)]
        if point.corner >= 0:
            others = [j for j in range(self.corners.size) if j != point.corner]
            orders = 1j * np.arange(1, self.smooth.size + 1)
            rest = trigonometric_value(self.smooth * orders, phase)
            moved[point.corner] = rest + sum(self._own_slope(j, phase) for j in others)
        return np.concatenate([np.ravel(part) for part in (parts, *own, *moved)])

    def _own_slope(self, corner: int, phase: Array) -> Array:
        kinds = enumerate(self.jumps[corner])
        distance = phase - self.corners[corner]
        return np.asarray(sum(jump * _corner_value(k + 1, distance) for k, jump in kinds))


def fit_smooth(phasors: Complex, noise: float, free: int) -> CornerWaveform:
    """
    Take the first harmonics as they are: a velocity without corners.

    Parameters and result are those of `fit_corners`.
    """
    design = _Design(phasors, noise, free)
    return design.waveform(np.empty(0), np.empty((0, 0)))


def fit_corners(phasors: Complex, noise: float, free: int) -> CornerWaveform:
    """
    Fit the model with two corners to the harmonics of a velocity.

    Parameters
    ----------
    phasors : ndarray of complex, shape (n,)
        Amplitudes and phases (m/s) of harmonics 1 ... n.
    noise : float
        Standard deviation of both parts of each (m/s), > 0.
    free : int
        Number of harmonics that are left free.

    Notes
    -----
    The phasors are linear in all but the places of the corners. Those are found on a grid first,
    half a period apart, and then by Gauss-Newton steps on the residual that is left when
    everything else has been fitted (variable projection).

    """
    design = _Design(phasors, noise, free)
    each = np.eye(2)
    corners = design.start()
    chi_square = design.project(corners, each)[2]
    for _ in range(_MOST_STEPS):
        step = design.step(corners)
        better = design.project(corners + step, each)[2]
        while better > chi_square and np.abs(step).max() > 1e-9:
            step = 0.3 * step
            better = design.project(corners + step, each)[2]
        if better > chi_square:
            break
        corners, chi_square = corners + step, better
        if np.abs(step).max() < 1e-7:
            break
    return design.waveform(np.mod(corners, TURN), each, are_fitted=True)


def fit_crossings(phasors: Complex, noise: float, free: int, crossings: Array) -> CornerWaveform:
    """
    Fit the model with corners at given places, and one jump for all, of alternating sign.

    Parameters
    ----------
    phasors, noise, free
        See `fit_corners`.
    crossings : ndarray, shape (m,)
        Phases (rad) at which the relative velocity changes sign, rising; m even.

    """
    signs = np.resize([1.0, -1.0], crossings.size)[:, None]
    return _Design(phasors, noise, free).waveform(crossings, signs)


def _parts(values: Complex) -> Array:
    """Return real parts, then imaginary parts, along the first axis."""
    return np.concatenate([values.real, values.imag])


def _columns(orders: NDArray[np.int64], corner: float, derivative: int) -> Array:
    """Return what the jumps of one corner contribute, or the derivatives by its phase."""
    turns = 2.0 * np.exp(-1j * orders * corner) * (-1j * orders) ** derivative
    return _parts(np.stack([turns / (1j * orders) ** (kind + 2) for kind in range(_KINDS)], 1))


def _matrix(count: int, free: int, corners: Array, signs: Array) -> Array:
    """
    Return the matrix that takes the linear parameters to the parts of the phasors.

    `signs`, shape (corners, groups), says with which sign each corner has the jumps of a group.
    """
    orders = np.arange(1, count + 1)
    smooth = np.zeros((count, 2 * free), dtype=np.complex128)
    smooth[np.arange(free), 2 * np.arange(free)] = 1.0
    smooth[np.arange(free), 2 * np.arange(free) + 1] = 1j
    groups = [np.zeros((2 * count, _KINDS)) for _ in range(signs.shape[1])]
    for corner, row in zip(corners, signs, strict=True):
        columns = _columns(orders, corner, 0)
        for group, sign in enumerate(row):
            groups[group] = groups[group] + sign * columns
    return np.hstack([_parts(smooth), *groups])


@cache
def _starts(count: int, free: int) -> tuple[tuple[float, Array], ...]:
    """Return phases of the first corner, and a basis of what the model can make with it."""
    phases = TURN / 2.0 * np.arange(_START_COUNT) / _START_COUNT
    pairs = ((phase, np.array([phase, phase + TURN / 2.0])) for phase in phases)
    return tuple(
        (float(p), np.linalg.qr(_matrix(count, free, pair, np.eye(2)))[0]) for p, pair in pairs
    )


class _Design:
    """The least-squares problem of the fits above."""

    def __init__(self, phasors: Complex, noise: float, free: int) -> None:
        self._orders = np.arange(1, phasors.size + 1)
        self._free = free
        self._noise = noise
        self._wanted = _parts(phasors) / noise

    def start(self) -> Array:
        """Return the best of some corners that are half a period apart."""
        starts = _starts(self._orders.size, self._free)
        explained = [float(np.sum((basis.T @ self._wanted) ** 2)) for _, basis in starts]
        phase = starts[int(np.argmax(explained))][0]
        return np.array([phase, phase + TURN / 2.0])

    def project(self, corners: Array, signs: Array) -> tuple[Array, Array, float]:
        """Return the linear parameters, the residual and its square, for given corners."""
        matrix = _matrix(self._orders.size, self._free, corners, signs) / self._noise
        solution = np.linalg.lstsq(matrix, self._wanted, rcond=1e-12)[0]
        found = np.asarray(solution, dtype=np.float64)
        residual = self._wanted - matrix @ found
        return found, residual, float(residual @ residual)

    def _jacobian(self, corners: Array, signs: Array, jumps: Array) -> Array:
        """Return the derivatives of the phasors by linear parameters and corners."""
        matrix = _matrix(self._orders.size, self._free, corners, signs)
        moved = [_columns(self._orders, c, 1) @ j for c, j in zip(corners, jumps, strict=True)]
        return np.column_stack([matrix, *moved]) / self._noise

    def _jumps(self, found: Array, signs: Array) -> Array:
        return np.asarray(signs @ found[2 * self._free :].reshape(-1, _KINDS))

    def step(self, corners: Array) -> Array:
        """Return by how much two corners with jumps of their own should move (rad)."""
        each = np.eye(corners.size)
        found, residual, _ = self.project(corners, each)
        matrix = self._jacobian(corners, each, self._jumps(found, each))
        step = np.linalg.lstsq(matrix, residual, rcond=1e-9)[0][-corners.size :]
        return np.asarray(np.clip(step, -_LONGEST_STEP, _LONGEST_STEP))

    def waveform(self, corners: Array, signs: Array, *, are_fitted: bool = False) -> CornerWaveform:
        """Return the fit for corners that have been fitted, or are given."""
        found, residual, chi_square = self.project(corners, signs)
        jumps = self._jumps(found, signs)
        matrix = self._jacobian(corners, signs, jumps)
        if not are_fitted:
            matrix = matrix[:, : found.size]
        smooth, count = self._with_rest(found, residual), 2 * self._free
        # from the parameters fitted to those of the waveform
        spread = np.zeros((2 * smooth.size + (_KINDS + 1) * corners.size, matrix.shape[1]))
        spread[:count, :count] = np.eye(count)
        first = 2 * smooth.size
        rows = slice(first, first + _KINDS * corners.size)
        spread[rows, count : found.size] = np.kron(signs, np.eye(_KINDS))
        if are_fitted:
            spread[rows.stop :, found.size :] = np.eye(corners.size)
        return CornerWaveform(
            smooth=smooth,
            corners=corners,
            jumps=jumps,
            jacobian=matrix,
            spread=spread,
            chi_square=chi_square,
            freedom=self._wanted.size - matrix.shape[1],
        )

    def _with_rest(self, found: Array, residual: Array) -> Complex:
        """Return the free phasors, and of those left over the ones that are more than noise."""
        parts = found[: 2 * self._free]
        rest = residual[: self._orders.size] + 1j * residual[self._orders.size :]
        rest[np.abs(rest) < _SIGNIFICANT] = 0.0
        rest[: self._free] = 0.0
        smooth = self._noise * rest
        smooth[: self._free] = parts[0::2] + 1j * parts[1::2]
        last = int(np.flatnonzero(smooth)[-1]) + 1 if smooth.any() else self._free
        return np.asarray(smooth[: max(last, self._free)])


def _covariance(matrix: Array) -> Array:
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv(matrix / scale, rcond=1e-9)
    return np.asarray((inverse @ inverse.T) / np.outer(scale, scale))
