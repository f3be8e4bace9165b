"""Reference numbers; READMEs in tests/data/adaptive and tests/data/feedforward explain them."""

import json
from pathlib import Path

import numpy as np
import pytest

from jcontour.controllers.feedforward.continuous_synchronisation import Motion
from jcontour.controllers.feedforward.model_matching import ModelMatching

DATA = Path(__file__).parents[3] / "data" / "adaptive" / "synchronisation.json"
OPTIMAL = Path(__file__).parents[3] / "data" / "feedforward"


@pytest.fixture(scope="session")
def synchronisation_numbers():
    """Contents of synchronisation.json."""
    return json.loads(DATA.read_text())


@pytest.fixture(scope="session")
def stepped():
    """Parameters -> a constant speed, and a load that steps on the second axis."""

    def of(p):
        def load(t):
            return np.array([0.0, p["d2_step"] * (t >= p["t_step"])])

        return Motion(lambda t: p["omega_d"], lambda t: 0.0, load, (p["t_step"],))

    return of


@pytest.fixture(scope="session")
def alter_tsao():
    return json.loads((OPTIMAL / "alter_tsao.json").read_text())


@pytest.fixture(scope="session")
def general_problems(alter_tsao):
    """(problem, its reference numbers) of the general zero sets."""
    found = []
    for row in alter_tsao["general_zeros"]:
        zeros = [0.0] * row["origin_multiplicity"] + [complex(*z) for z in row["zeros"]]
        found.append((ModelMatching(zeros, row["M_num"], row["M_den"]), row))
    return found


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
        found = np.array(zeros, complex)
        apart = np.abs(found[:, None] - found) + 2 * np.eye(count)
        if apart.min() > 0.1:
            preview = np.zeros(random.integers(0, 8))
            return ModelMatching(found, np.concatenate([preview, random.standard_normal(3)]))
