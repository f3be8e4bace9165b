"""Invariant polytopes: invariance at every corner, and growth as the margin falls."""

import numpy as np
import pytest
from scipy.optimize import linprog

from jcontour.sets.disturbed_model import DisturbedModel
from jcontour.sets.invariant_polytopes import control_invariant
from jcontour.sets.polytopes import box

CORNERS = np.linspace(0, 2 * np.pi, 41)
AROUND = np.stack([np.cos(CORNERS), np.sin(CORNERS)], axis=1)


@pytest.fixture(scope="module")
def pushed():
    """A mass on a slide, |x| <= 1, |v| <= 1, |u| <= 1, sampled every 0.4 s."""
    dt = 0.4
    return DisturbedModel.of([[1, dt], [0, 1]], [dt**2 / 2, dt], [0.02, 0.1])


def support(found):
    return (found.corners @ AROUND.T).max(axis=0)


def test_algorithm_1_gives_a_control_invariant_set(pushed):
    """Every vertex has one control that keeps both disturbed states inside."""
    found = control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=1e-2)
    H, h = found.polytope
    for x in found.polytope.corners:
        rows = np.concatenate([H @ pushed.B, [[1.0], [-1.0]]])
        room = h - H @ pushed.A @ x - np.abs(H @ pushed.E).sum(axis=1)
        answer = linprog([0.0], rows, np.append(room, [1.0, 1.0]), bounds=(None, None))
        assert answer.status == 0


def test_algorithm_1_tends_to_the_largest_set(pushed):
    """With a smaller margin the set grows; no set has to grow beyond what is allowed."""
    margins = (1e-2, 1e-3, 1e-4)
    found = [control_invariant(pushed, box([1.0, 1.0]), np.ones(1), one) for one in margins]
    sizes = [support(one.polytope) for one in found]
    assert (np.diff(sizes, axis=0) >= -1e-9).all()
    assert found[-1].polytope.within(box([1.0, 1.0]), 1e-9)


def test_too_large_a_disturbance_leaves_nothing(pushed):
    strong = pushed._replace(E=np.array([[0.0], [1.5]]))
    assert control_invariant(strong, box([1.0, 1.0]), np.array([1.0]), margin=1e-3) is None


def test_bad_input_is_named(pushed):
    with pytest.raises(ValueError, match="margin: needs to be above zero"):
        control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=0.0)
    with pytest.raises(ValueError, match="most_steps: no end after 1 steps"):
        control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=1e-6, most_steps=1)
