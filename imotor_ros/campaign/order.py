"""In which order the points of a campaign are measured, and how often each."""

from __future__ import annotations

import numpy as np

from imotor_ros.errors import BadInputError

ORDERS = ("rounds", "together", "random")
"""All points once and then again; repetitions of a point in a row; all of them shuffled."""


def sequence_of(
    count: int, repetitions: int = 1, order: str = "rounds", seed: int = 0
) -> list[tuple[int, int]]:
    """
    Return the sequence of runs as pairs of the number of the point and of its repetition.

    Parameters
    ----------
    count : int
        Number of points.
    repetitions : int
        How often each point is measured.
    order : str
        One of `ORDERS`.
    seed : int
        Seed of the random order; the same seed gives the same order.

    Raises
    ------
    BadInputError
        If a value is not accepted.

    """
    for name, value, low in (("repetitions", repetitions, 1), ("order_seed", seed, 0)):
        if not isinstance(value, int) or isinstance(value, bool) or value < low:
            raise BadInputError(
                "is not accepted", where=name, value=value, bound=f"a whole number >= {low}"
            )
    if order not in ORDERS:
        raise BadInputError(
            "is not an order", where="order", value=order, bound="one of " + ", ".join(ORDERS)
        )
    rounds = [(point, repeat) for repeat in range(repetitions) for point in range(count)]
    if order == "together":
        return sorted(rounds)
    if order == "random":
        shuffled = np.random.default_rng(seed).permutation(len(rounds))
        return [rounds[int(number)] for number in shuffled]
    return rounds
