"""Searches without slopes find the lowest point of a bowl, and stop when their budget is spent."""

import numpy as np
import pytest

from experiments.benchmarks.searches.search_methods import METHODS, Spent

LOWEST = np.array([1.3, -0.4])
ENOUGH = {"CMA-ES": 0.05, "TPE": 1.0, "Nelder-Mead": 0.05, "Sobol": 1.0, "grid": 1.0}


@pytest.mark.parametrize("method", METHODS)
def test_a_method_comes_near_the_lowest_point(method):
    tried = []

    def measure(z):
        if len(tried) == 300:
            raise Spent
        tried.append(z)
        return float(np.sum((z - LOWEST) ** 2))

    start, box = np.array([-2.0, 2.0]), np.array([[-7.0, -3.0], [3.0, 7.0]])
    with pytest.raises(Spent):
        METHODS[method](measure, start, box, 1)
    assert np.min(np.linalg.norm(np.array(tried) - LOWEST, axis=1)) < ENOUGH[method]
    if method != "grid":
        np.testing.assert_allclose(tried[0], start, atol=4.0)
    assert np.all(np.array(tried) >= box[0] - 1e-9) and np.all(np.array(tried) <= box[1] + 1e-9)
