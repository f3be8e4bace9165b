"""Maps of a sample against the axis's own steps."""

import equinox as eqx
import numpy as np
import pytest

from jcontour.guarantees.friction.friction_columns import frictionless, sample_maps
from jcontour.plants.flexible_axis.axis import FlexibleAxis, Motion, SlidingMotion, thesis_axis
from jcontour.plants.friction import Friction

START = [0.01, 0.08, 0.0101, 0.075]


def sliding(coulomb, cogging=0.0):
    """The thesis's axis with friction that is the same at all speeds, and constant cogging."""
    p = thesis_axis()
    friction = Friction(coulomb, 0.0, 1.0, p.friction.viscous)
    p = eqx.tree_at(
        lambda p: (p.friction, p.cogging_sine, p.cogging_cosine),
        p,
        (friction, 0 * p.cogging_sine, 0 * p.cogging_cosine),
    )
    return FlexibleAxis(p, dt=1e-3, substeps=4)


def stepped(axis, control):
    state = SlidingMotion(Motion(*(np.array([value]) for value in START)), np.array([1]))
    return np.ravel(eqx.filter_jit(axis.step)(state, np.array([control])).motion)


def test_a_sample_without_dry_friction_and_under_a_constant_one():
    model, maps = frictionless(sliding(0.0)), sample_maps(sliding(0.0))
    alone = np.asarray(model.A) @ START + np.asarray(model.B)[:, 0] * 1.5
    assert alone == pytest.approx(stepped(sliding(0.0), 1.5), rel=1e-12)
    slowed = alone - 20.0 * maps.forced[-1].sum(axis=1)
    assert slowed == pytest.approx(stepped(sliding(20.0), 1.5), rel=1e-12)
    assert maps.later(maps.pushed).sum(axis=1) == pytest.approx(maps.forced[-1].sum(axis=1))


def test_several_axes_are_told():
    p = thesis_axis()
    two = eqx.tree_at(lambda p: p.motor_mass, p, np.array([30.0, 40.0]))
    with pytest.raises(ValueError, match="axis: needs one, received 2"):
        sample_maps(FlexibleAxis(two, dt=1e-3))
