"""The exponential regression on curves whose parameters are known."""

import math

import numpy as np
import pytest

from imotor_ros.core.regression import fit_exponential, fit_period_means, start_up_time
from imotor_ros.errors import BadInputError


@pytest.mark.parametrize("tau", [0.4, 3.0, 40.0, 300.0])
@pytest.mark.parametrize("amplitude", [-0.2, 0.05])
def test_parameters_of_an_exact_exponential_come_back(tau, amplitude):
    t = np.arange(1000) + 0.5
    fit = fit_exponential(t, 0.1 + amplitude * np.exp(-t / tau))
    assert fit.is_valid
    # the search over the time constant ends at 1e-8
    assert fit.asymptote == pytest.approx(0.1, rel=1e-8)
    assert fit.time_constant == pytest.approx(tau, rel=1e-6)
    assert fit.amplitude == pytest.approx(amplitude, rel=1e-6)
    # the curve crosses zero for some of them
    assert fit.value(t) == pytest.approx(0.1 + amplitude * np.exp(-t / tau), abs=1e-9)


def test_covariance_describes_the_scatter():
    t, rng = np.arange(200) * 1.0, np.random.default_rng(5)
    fits = [
        fit_exponential(t, 1.0 - 0.5 * np.exp(-t / 20.0) + 0.01 * rng.standard_normal(t.size),
                        np.full(t.size, 0.01))
        for _ in range(200)
    ]  # fmt: skip
    found = np.array([(f.asymptote, f.time_constant, f.amplitude) for f in fits])
    stated = np.sqrt(np.mean([np.diag(f.covariance) for f in fits], axis=0))
    # the standard deviation of 200 draws is known to 5 %; four times that
    assert found.std(axis=0) / stated == pytest.approx(1.0, abs=0.2)
    assert abs(found.mean(axis=0) - (1.0, 20.0, -0.5)) == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize(("amplitude", "name"), [(-0.08, "t_0.99"), (0.05, "t_1.01")])
def test_start_up_time_is_that_of_the_exponential(amplitude, name):
    period, tau, v = 1e-3, 7e-3, 0.1
    t = (np.arange(400) + 0.5) * period
    found = start_up_time(v + amplitude * np.exp(-t / tau), period)
    assert found.value == pytest.approx(tau * math.log(abs(amplitude) / (0.01 * v)), rel=1e-6), name
    assert not found.is_bound
    assert not found.reason


def test_motor_steady_from_the_first_period_has_a_bound_of_one_period():
    found = start_up_time(np.full(50, 0.2), 1e-3)
    assert (found.value, found.is_bound, found.reason) == (1e-3, True, "")


def test_motor_steady_from_the_second_period_has_a_bound_of_two():
    means = np.full(50, 0.2)
    means[0] = 0.1
    found = start_up_time(means, 1e-3)
    assert (found.value, found.is_bound) == (2e-3, True)


def test_record_that_ends_too_early_gives_no_start_up_time():
    t = np.arange(100) + 0.5
    found = start_up_time(1.0 - np.exp(-t / 500.0), 1.0)
    assert math.isnan(found.value)
    assert "ends before" in found.reason


def test_points_that_determine_nothing_are_said_so():
    assert not fit_exponential([0.0, 1.0, 2.0], [1.0, 2.0, 3.0]).is_valid
    assert math.isnan(start_up_time([], 1.0).value)
    assert math.isnan(start_up_time(np.zeros(20), 1.0).value)


def test_unusable_points_are_refused():
    for times, values in (([0, 1], [1, 2, 3]), ([0, 1], [1, math.nan]), ([1, 1], [1, 2])):
        with pytest.raises(BadInputError):
            fit_exponential(times, values)


@pytest.mark.parametrize("tau", [0.3, 3.0, 40.0, 400.0])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("settled", [60, 4000])
def test_regression_of_period_means_is_the_general_one(tau, noise, settled):
    """Also where the last means are the same number."""
    period, j = 1e-4, np.arange(4000) + 0.5
    means = 0.1 - 0.08 * np.exp(-j / tau) + noise * np.random.default_rng(7).standard_normal(4000)
    means[settled:] = means[-1]
    general, fast = fit_exponential(j * period, means), fit_period_means(means, period)
    assert fast.reason == general.reason
    # rounding of the cost, 1e-16 of 4000 squares of the noise, hides steps of the time constant
    assert fast.time_constant == pytest.approx(general.time_constant, rel=1e-5)
    assert fast.asymptote == pytest.approx(general.asymptote, rel=1e-9)
    assert fast.amplitude == pytest.approx(general.amplitude, rel=1e-5)
    # residuals of an exact exponential are rounding
    assert fast.residual == pytest.approx(general.residual, rel=1e-6, abs=1e-12)
    if general.residual > 1e-12:
        assert fast.covariance == pytest.approx(general.covariance, rel=1e-4)
