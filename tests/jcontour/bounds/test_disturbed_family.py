"""Families under disturbances: each member as it is alone, and a run that leaves its contour."""

import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour.bounds.certificates import certificate
from jcontour.bounds.disturbed_family import DisturbedFamily
from jcontour.bounds.disturbed_loop import Box
from jcontour.geometry.contours import circle, line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.evaluation import member, stack_plants, stack_references

BOX = Box.of([1e-6, 2e-6], [3e-7, 1e-7], inputs=2, measured=2)
LIMIT = np.array([1e-4, 2e-4])


def integrators(*slopes):
    return LinearPlant(np.eye(2), np.diag(slopes), np.eye(2), 1e-3)


@pytest.mark.slow
def test_members_have_the_bounds_and_attacks_that_they_have_alone(proportional_problem):
    plants = [integrators(1.0, 0.7), integrators(0.9, 0.8)]
    runs = [
        along(circle(1e-3), 1e-4 * np.arange(20), 1e-3, 0, at_rest=False),
        along(line([0.0, 0.0], [1e-3, 5e-4]), 1e-4 * np.arange(11), 1e-3, 0, at_rest=False),
    ]
    controller = proportional_problem().build({"x": 0.5, "y": 0.8})
    references = stack_references(runs)
    family = DisturbedFamily(stack_plants(plants), BOX.force, BOX.noise, LIMIT)
    loops = jax.device_get(eqx.filter_jit(family.loops)(controller, references))
    values, worst = family.worst(loops, references, None)
    attacked = eqx.filter_jit(family.attacked)(controller, references, worst)
    np.testing.assert_allclose(attacked, values, rtol=1e-9)
    for c, p in np.ndindex(2, 2):
        found = certificate(plants[p], controller, member(references, c), BOX)
        # a sum of two deviations that the certificate takes at right angles: alike beside a line
        assert values.error[c, p] <= found.largest * (1 + (1e-5 if c == 0 else 0))
        assert values.error[c, p] > 0.98 * found.largest
        run = np.flatnonzero(found.scored)[-1] + 1  # what is padded does not count
        use = np.max(found.control[:run] / LIMIT)
        assert values.control_use[c, p] == pytest.approx(use, rel=1e-9)


@pytest.mark.slow
def test_a_run_that_leaves_its_contour_has_no_bound(proportional_problem):
    run = along(circle(1e-3), 1e-4 * np.arange(20), 1e-3, 0, at_rest=False)
    controller = proportional_problem().build({"x": 9.0, "y": 9.0})
    references = stack_references([run])
    family = DisturbedFamily(stack_plants([integrators(1.0, 1.0)]), BOX.force, BOX.noise, LIMIT)
    loops = jax.device_get(eqx.filter_jit(family.loops)(controller, references))
    values, worst = family.worst(loops, references, None)
    assert np.isinf(values.error) and np.isinf(values.control_use)
    assert not np.any(worst.error.force) and worst.error.force.shape == (1, 1, 2, 20, 2)
