"""Currents for a straight beam, against the equation of motion."""

import equinox as eqx
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.parameters import thesis_gantry
from jcontour.plants.gantry.straight_beam import currents_along, straight_beam_currents


def test_the_beam_stays_straight_and_the_tool_accelerates_as_wanted():
    p = thesis_gantry()
    position, speed = np.array([[0.3, -0.1]]), np.array([[0.2, -0.4]])
    acceleration = np.array([[1.5, -2.0]])
    (control,) = np.asarray(
        straight_beam_currents(p, *map(placed, (position, speed, acceleration)))
    )
    q = np.array([0.3, -0.1 + float(p.tool_offset), 0.0])
    v = np.array([0.2, -0.4, 0.0])
    found = eqx.filter_jit(EquationOfMotion.of(p).acceleration)(q, v, control)
    np.testing.assert_allclose(found, [1.5, -2.0, 0.0], atol=1e-12)


def test_a_steady_motion_takes_its_friction_and_rest_takes_nothing():
    p, dt = thesis_gantry(), 1e-2
    steps = np.concatenate([np.zeros(3), np.ones(5)])
    position = np.cumsum(steps)[:, None] * np.array([1e-3, 2e-3])
    found = np.asarray(currents_along(p, placed(position), dt))
    assert found.shape == (8, 3)
    np.testing.assert_allclose(found[0], 0.0, atol=1e-12)
    head = float(p.head_viscous * 0.1 / p.head_constant)
    beam = float(p.drive_viscous * 0.2 / p.drive_constant)
    np.testing.assert_allclose(found[5], [head, beam, beam], rtol=1e-9)


def test_the_head_stays_on_the_beam():
    none = placed(np.zeros((1, 2)))
    with pytest.raises(ValueError, match="position: the head runs from"):
        straight_beam_currents(thesis_gantry(), placed(np.array([[1.0, 0.0]])), none, none)
