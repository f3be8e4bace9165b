"""Reference numbers; the README in tests/data/feedforward explains them."""

import numpy as np
import pytest

from jcontour.controllers.feedforward.model_matching import ModelMatching
from jcontour.motion.references import from_samples
from jcontour.plants.arms import leg_lengths, manipulator_path
from tests.reference_data import numbers_of


@pytest.fixture(scope="session")
def link():
    """Sample period, preview -> the path of the manipulator's first leg, from rest to rest."""

    def of(dt, preview, count=None, first=0):
        legs = leg_lengths(manipulator_path(dt * np.arange(round(6 / dt) + 1)))
        away = (legs - legs[:1])[first:, :1]
        away = away if count is None else away[: count + preview]
        if count is None:
            away = np.concatenate([away, np.repeat(away[-1:], preview, axis=0)])
        return from_samples(away, np.ones_like(away), dt, preview, in_motion=False)

    return of


@pytest.fixture(scope="session")
def alter_tsao():
    return numbers_of("feedforward/alter_tsao")


@pytest.fixture(scope="session")
def general_problems(alter_tsao):
    """(problem, its reference numbers) of the general zero sets."""
    actual = []
    for row in alter_tsao["general_zeros"]:
        zeros = [0.0] * row["origin_multiplicity"] + [complex(*z) for z in row["zeros"]]
        actual.append((ModelMatching(zeros, row["M_num"], row["M_den"]), row))
    return actual


@pytest.fixture(scope="session")
def random_problems():
    """200 problems of one to six unstable zeros, real ones and pairs, at least 0.1 apart."""
    random = np.random.default_rng(0)
    return [_problem(random) for _ in range(200)]


def _problem(random):
    count = random.integers(1, 7)
    while True:
        zeros = []
        while len(zeros) < count:
            radius = 0.9 * np.sqrt(random.uniform())
            if len(zeros) < count - 1 and random.uniform() < 0.4:
                zero = radius * np.exp(1j * random.uniform(0, np.pi))
                zeros += [zero, zero.conjugate()]
            else:
                zeros.append(radius * random.choice([-1, 1]))
        actual = np.array(zeros, complex)
        apart = np.abs(actual[:, None] - actual) + 2 * np.eye(count)
        if apart.min() > 0.1:
            preview = np.zeros(random.integers(0, 8))
            return ModelMatching(actual, np.concatenate([preview, random.standard_normal(3)]))
