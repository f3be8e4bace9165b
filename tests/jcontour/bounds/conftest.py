"""The circle of the reference numbers, and a small loop that changes with time."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from jcontour.bounds.disturbed_loop import Box, DisturbedLoop
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import FilterObserver
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.plants.encoders import Encoders
from jcontour.plants.linear_machines import bridgeport

DATA = Path(__file__).parents[2] / "data/guarantees/circle.json"


@cache
def _circle():
    return json.loads(DATA.read_text())


class Circle:
    """Machine, path and numbers of the reference circle."""

    def __init__(self):
        self.numbers = _circle()
        self.model = bridgeport()
        self.plant = Encoders(self.model)
        self.path = circle(self.numbers["radius_m"])
        lap = self.numbers["lap_samples"]
        arc = np.arange(lap * self.numbers["laps"]) * float(self.path.length) / lap
        self.reference = along(
            self.path, arc, self.model.dt, self.numbers["preview"], at_rest=False
        )
        self.rows = self.numbers["rows"]

    def controller(self, alpha, beta, rho):
        weights = LQWeights(alpha, beta, rho)
        inner = ContouringLQ(self.model, weights, self.numbers["preview"])
        gain = np.asarray(self.numbers["kalman"]["L"])
        return FilterObserver(inner, self.model, gain=gain)

    def of(self, row):
        """Controller and box of a row of the numbers."""
        size = row["size"]
        controller = self.controller(row["alpha"], row["beta"], row["rho"])
        return controller, Box.of(size[:2], size[2:], inputs=2, measured=2)


@pytest.fixture(scope="session")
def reference_circle():
    return Circle()


def _random_loop(seed: int, steps: int, states: int = 4) -> DisturbedLoop:
    random = np.random.default_rng(seed)
    M = random.standard_normal((steps, states, states))
    M *= 0.9 / np.linalg.norm(M, 2, axis=(1, 2))[:, None, None]
    E, C = random.standard_normal((steps, states, 3)), random.standard_normal((steps, 2, states))
    none = np.zeros((steps, 2))
    return DisturbedLoop(M, E, C, C, np.zeros((steps, 2, 1)), none, none)


@pytest.fixture(scope="session")
def random_loop():
    """(seed, steps, states) -> DisturbedLoop of two forces and one measured number."""
    return _random_loop


def _pushed(loop, w):
    """States z(k) under a disturbance (T, d), by the recursion itself."""
    M, E = np.asarray(loop.M), np.asarray(loop.E)
    z = np.zeros((len(M), M.shape[1]))
    for k in range(len(M) - 1):
        z[k + 1] = M[k] @ z[k] + E[k] @ w[k]
    return z


@pytest.fixture(scope="session")
def pushed():
    """(loop, w) -> states z(k) under a disturbance."""
    return _pushed


def _circle_bound(
    centre: Float[np.ndarray, " 2"],
    radius: float,
    output: Float[np.ndarray, " 2"],
    generators: Float[np.ndarray, "2 g"],
) -> tuple[float, float]:
    """Largest distances outside and inside of a circle over a zonotope of positions, exact [m].

    The tool may be anywhere in y + sum_i [-1, 1] g_i. Outside, the distance from the centre is
    convex, and largest at a vertex. Inside, it is least at the nearest point of the zonotope.
    """
    corners = output - centre + _vertices(generators)
    outside = np.linalg.norm(corners, axis=1).max() - radius
    return float(outside), float(radius - _least_norm(corners))


def _vertices(generators: np.ndarray) -> np.ndarray:
    """Vertices of a planar zonogon around zero (2 g, 2), counter-clockwise."""
    upward = (generators[1] > 0) | ((generators[1] == 0) & (generators[0] > 0))
    turned = np.where(upward, generators, -generators)
    order = np.argsort(np.arctan2(turned[1], turned[0]))
    edges = 2 * turned[:, order].T
    lower = np.concatenate([np.zeros((1, 2)), np.cumsum(edges, axis=0)]) - turned.sum(axis=1)
    return np.concatenate([lower, -lower])


def _least_norm(corners: np.ndarray) -> float:
    """Distance of zero from a convex polygon, zero inside."""
    after = np.roll(corners, -1, axis=0)
    edge = after - corners
    square = np.maximum(np.sum(edge**2, axis=1), np.finfo(float).tiny)
    part = np.clip(-np.sum(corners * edge, axis=1) / square, 0.0, 1.0)
    turn = corners[:, 0] * edge[:, 1] - corners[:, 1] * edge[:, 0]
    if np.all(turn >= 0) and np.sum(turn) > 0:
        return 0.0
    return float(np.linalg.norm(corners + part[:, None] * edge, axis=1).min())


@pytest.fixture(scope="session")
def circle_bound():
    """(centre, radius, output, generators) -> largest distances outside and inside of a circle."""
    return _circle_bound
