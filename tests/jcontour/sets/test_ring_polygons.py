"""Algorithm 2 against reference numbers and its own conditions."""

import json
from pathlib import Path

import numpy as np
import pytest

from jcontour.sets.ring_polygons import ring_polygons, room_across

DATA = Path(__file__).parents[2] / "data" / "guarantees"
CASES = json.loads((DATA / "polygons.json").read_text())


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['R']}-{case['eps']}")
def test_side_numbers_are_the_reference(case):
    found = ring_polygons(case["R"], case["eps"])
    assert (found.inner, found.outer) == (case["n_in"], case["n_out"])
    assert found.vertex == pytest.approx(case["l_vert"], rel=1e-12)


def test_the_circle_of_the_thesis_is_outside_a_polygon_of_ten_sides():
    found = ring_polygons(80e-3, 4e-3)
    assert (found.inner, found.outer) == (10, 11)
    assert 84e-3 * np.cos(np.pi / 10) == pytest.approx(79.889e-3, abs=1e-6)
    assert found.side >= 80e-3


def test_the_room_across_lies_in_the_ring():
    radius, tolerance, along = 20e-3, 1e-3, 4e-3
    across = room_across(radius, tolerance, along)
    corners = np.array([[radius + a, b] for a in (-across, across) for b in (-along, 0, along)])
    distances = np.linalg.norm(corners, axis=1)
    assert distances.max() == pytest.approx(radius + tolerance)
    assert distances.min() >= radius - tolerance
    assert room_across(np.inf, tolerance, along) == tolerance
    assert room_across(radius, tolerance, 0.0) == pytest.approx(tolerance)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="tolerance: needs to be between zero and the radius"):
        ring_polygons(1.0, 1.0)
    with pytest.raises(ValueError, match="along: 0.01 m along a path of radius 0.02 m leaves no"):
        room_across(20e-3, 1e-3, 10e-3)
    with pytest.raises(ValueError, match="need to be above zero"):
        room_across(20e-3, 0.0, 1e-3)
