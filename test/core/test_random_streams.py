"""Random streams: repeatable by seed and name, independent otherwise."""

import numpy as np
import pytest

from imotor_ros.core.random_streams import generator
from imotor_ros.errors import BadInputError


def test_generator_repeats_for_the_same_seed_and_name() -> None:
    first = generator(7, "rod/velocity/noise").standard_normal(1000)
    second = generator(7, "rod/velocity/noise").standard_normal(1000)
    assert np.array_equal(first, second)


@pytest.mark.parametrize(
    ("seed", "name"), [(8, "rod/velocity/noise"), (7, "slider/velocity/noise"), (7, "")]
)
def test_generator_is_independent_of_other_seeds_and_names(seed: int, name: str) -> None:
    first = generator(7, "rod/velocity/noise").standard_normal(100_000)
    second = generator(seed, name).standard_normal(100_000)
    # five standard deviations of the correlation of independent numbers
    assert abs(first @ second) / 100_000 < 5.0 / np.sqrt(100_000)


def test_generator_draws_alike_in_one_block_and_in_many() -> None:
    whole = generator(1, "noise").standard_normal(10_000)
    parts = generator(1, "noise")
    cut = np.concatenate([parts.standard_normal(n) for n in (1, 777, 0, 9222)])
    assert np.array_equal(whole, cut)


@pytest.mark.parametrize("seed", [-1, 1.5, "1", None, True])
def test_generator_refuses_what_is_no_seed(seed: object) -> None:
    with pytest.raises(BadInputError, match="seed"):
        generator(seed, "noise")  # type: ignore[arg-type]
