"""
Fills Numba's cache with all compiled code of the package; `python -m` runs this module.

Kernels with explicit signatures are compiled when their module is imported, the others when they
are first called. Done once after an installation, no run waits for the compiler.
"""

from __future__ import annotations

import importlib
import pkgutil
import time
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import imotor_ros.core
from imotor_ros.core import closed_form, sampled, taylor
from imotor_ros.core.friction import CoulombFriction
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.slider import LoadParameters, SliderParameters


def _solve_closed_form() -> None:
    motion = parabolic_sawtooth(2, fundamental_frequency=1000.0)
    table = closed_form.simulate(
        motion, SliderParameters(), CoulombFriction(), periods=1, record=True
    )
    assert table.trajectory is not None
    table.trajectory.sample([0.0])


def _solve_by_series() -> None:
    motion = parabolic_sawtooth(2, fundamental_frequency=1000.0)
    taylor.simulate(motion, SliderParameters(), CoulombFriction(), periods=1)


def _solve_in_samples() -> None:
    motion = parabolic_sawtooth(2, fundamental_frequency=1000.0)
    sampled.simulate(
        motion, SliderParameters(), CoulombFriction(), load=LoadParameters(), periods=1,
        sample_rate=100e3,
    )  # fmt: skip


EXAMPLES: Mapping[str, Callable[[], object]] = MappingProxyType(
    {
        "closed form": _solve_closed_form,
        "power series": _solve_by_series,
        "stepping": _solve_in_samples,
    }
)
"""Calls that compile what has no explicit signature."""


def compile_all() -> Iterator[tuple[str, float]]:
    """
    Compile everything that is not in the cache yet.

    Yields
    ------
    tuple of str and float
        What was compiled or found in the cache, and how long that took (s).

    """
    for module in pkgutil.iter_modules(imotor_ros.core.__path__):
        start = time.perf_counter()
        importlib.import_module(f"imotor_ros.core.{module.name}")
        yield module.name, time.perf_counter() - start
    for name, call in EXAMPLES.items():
        start = time.perf_counter()
        call()
        yield name, time.perf_counter() - start


def main() -> None:
    """Compile, and say what took longer than a moment."""
    for name, seconds in compile_all():
        if seconds > 0.5:
            print(f"{name}: {seconds:.1f} s")  # noqa: T201


if __name__ == "__main__":
    main()
