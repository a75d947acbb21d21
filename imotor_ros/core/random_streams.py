"""Random numbers of a run: one independent stream per seed and name."""

from __future__ import annotations

import hashlib

import numpy as np

from imotor_ros.errors import BadInputError


def generator(seed: int, name: str) -> np.random.Generator:
    """
    Return the random number generator of one purpose in one run.

    Every instrument takes its streams by name, so that its samples depend on neither the
    order in which instruments are made nor the process in which they run.

    Parameters
    ----------
    seed : int
        Seed of the run, >= 0.
    name : str
        Who draws and what for, e.g. "slider/velocity/noise".

    Returns
    -------
    numpy.random.Generator
        Independent of the generator of any other seed or name.

    Raises
    ------
    BadInputError
        If `seed` is negative or no whole number.

    Examples
    --------
    >>> first, second = (generator(3, "rod/velocity/noise").random() for _ in range(2))
    >>> first == second
    True

    """
    is_whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, bool)
    if not is_whole or seed < 0:
        raise BadInputError("is no seed", where="seed", value=seed, bound="a whole number >= 0")
    digest = hashlib.sha256(name.encode()).digest()
    words = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.Generator(
        np.random.SFC64(np.random.SeedSequence(entropy=int(seed), spawn_key=words))
    )
