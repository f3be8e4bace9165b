"""Algorithm 2 against reference numbers and its own conditions."""

import json
from pathlib import Path

import numpy as np
import pytest

from jcontour.sets.ring_polygons import ring_polygons

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


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="tolerance: needs to be between zero and the radius"):
        ring_polygons(1.0, 1.0)
