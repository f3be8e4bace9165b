"""Invariant polytopes: invariance at every vertex, maximality, and the reference's fixed gain."""

import numpy as np
import pytest
from scipy.optimize import linprog

from jcontour.sets.disturbed_model import DisturbedModel
from jcontour.sets.invariant_polytopes import control_invariant, invariant_under_gain
from jcontour.sets.minimal_sets import minimal_supports
from jcontour.sets.polytopes import box, polytope

CORNERS = np.linspace(0, 2 * np.pi, 41)
AROUND = np.stack([np.cos(CORNERS), np.sin(CORNERS)], axis=1)


@pytest.fixture(scope="module")
def pushed():
    """A mass on a slide, |x| <= 1, |v| <= 1, |u| <= 1, sampled every 0.4 s."""
    dt = 0.4
    return DisturbedModel.of([[1, dt], [0, 1]], [dt**2 / 2, dt], [0.02, 0.1])


def farthest(found, row):
    return linprog(-row, found.H, found.h, bounds=(None, None), method="highs").x


def test_the_largest_set_of_the_thesis_gain_is_smaller_than_its_box():
    """A lag: |x| <= 1 stays inside exactly if the disturbance leaves room."""
    assert invariant_under_gain([[0.5]], [0.4], box([1.0])).polytope.support([[1.0]]) == 1.0
    assert invariant_under_gain([[0.5]], [0.6], box([1.0])) is None


def test_states_of_the_set_stay_in_it_under_the_gain(pushed):
    M = pushed.A - pushed.B @ [[0.6, 1.2]]
    found = invariant_under_gain(M, pushed.E, box([1.0, 1.0]))
    smallest = minimal_supports(M, pushed.E, AROUND).value
    assert (found.polytope.support(AROUND) >= smallest - 1e-9).all()
    for row in AROUND[::4]:
        x = farthest(found.polytope, row)
        for w in (-1.0, 1.0):
            assert found.polytope.contains(M @ x + pushed.E[:, 0] * w, 1e-9)


@pytest.mark.slow
def test_the_set_of_the_thesis_gain_is_the_reference(axis_numbers, thesis_numbers):
    wanted = thesis_numbers["rpi"]
    scale, K = np.array(wanted["scale_e"]), np.array(wanted["K_scaled"])
    A = np.array(axis_numbers["A"]) * scale / scale[:, None]
    B = np.array(axis_numbers["B"]) * wanted["scale_u"] / scale
    E = np.stack([axis_numbers["E"], axis_numbers["G"]], axis=1) / scale[:, None]
    states = box(wanted["box"])
    allowed = polytope([*states.H, K, -K], [*states.h, wanted["ub"], wanted["ub"]])
    found = invariant_under_gain(A - np.outer(B, K), E, allowed)
    assert (found.steps, len(found.polytope.h)) == (wanted["determination_index"], wanted["rows"])
    supports = found.polytope.support(wanted["directions"])
    np.testing.assert_allclose(supports, wanted["support"], rtol=1e-6)


def test_algorithm_1_gives_a_control_invariant_set(pushed):
    """Every vertex has one control that keeps both disturbed states inside."""
    found = control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=1e-2)
    H, h = found.polytope
    for row in AROUND[::4]:
        x = farthest(found.polytope, row)
        rows = np.concatenate([H @ pushed.B, [[1.0], [-1.0]]])
        room = h - H @ pushed.A @ x - np.abs(H @ pushed.E).sum(axis=1)
        answer = linprog([0.0], rows, np.append(room, [1.0, 1.0]), bounds=(None, None))
        assert answer.status == 0


@pytest.mark.slow
def test_algorithm_1_tends_to_the_largest_set(pushed):
    """With a smaller margin the set grows; the set of a gain that respects the limit lies in it."""
    sizes = []
    for margin in (1e-2, 1e-3, 1e-4):
        found = control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin).polytope
        sizes.append(found.support(AROUND))
    assert (np.diff(sizes, axis=0) >= -1e-9).all()
    K = np.array([0.6, 1.2])
    states = box([1.0, 1.0])
    allowed = polytope([*states.H, K, -K], [*states.h, 1.0, 1.0])
    under_gain = invariant_under_gain(pushed.A - pushed.B @ [K], pushed.E, allowed).polytope
    assert (under_gain.support(AROUND) <= sizes[-1] + 2e-3).all()


def test_too_large_a_disturbance_leaves_nothing(pushed):
    strong = pushed._replace(E=np.array([[0.0], [1.5]]))
    assert control_invariant(strong, box([1.0, 1.0]), np.array([1.0]), margin=1e-3) is None


def test_bad_input_is_named(pushed):
    with pytest.raises(ValueError, match="margin: needs to be above zero"):
        control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=0.0)
    with pytest.raises(ValueError, match="most_steps: no end after 1 steps"):
        control_invariant(pushed, box([1.0, 1.0]), np.array([1.0]), margin=1e-6, most_steps=1)
    with pytest.raises(ValueError, match="most_steps: no end after 1 steps"):
        invariant_under_gain(pushed.A - pushed.B @ [[0.6, 1.2]], pushed.E, box([1.0, 1.0]), 1)
