"""Worst cases: the value of a certificate, and its derivative against central differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.frozen_loops import unlimited
from jcontour.bounds.certificates import certificate
from jcontour.bounds.disturbed_loop import Box, disturbed_loop
from jcontour.bounds.worst_cases import attacked_peaks, worst_case

LAST_LAP = (504, 756)
LIMIT = np.full(2, 10.0)


class Lap:
    """Worst case of the reference circle as a function of ln(alpha), ln(beta), ln(rho)."""

    def __init__(self, circle):
        row = circle.rows[0]
        self.circle, self.reference = circle, circle.reference
        self.plant, self.box = circle.plant, circle.of(row)[1]
        self.start = jnp.log(jnp.array([row["alpha"], row["beta"], row["rho"]]))

    def worst(self, logs):
        loop = disturbed_loop(self.plant, self.circle.controller(*jnp.exp(logs)), self.reference)
        return worst_case(loop, self.reference, self.box, LIMIT, LAST_LAP)

    @eqx.filter_jit
    def slopes(self, logs, worst):
        def attacked(logs):
            controller = unlimited(self.circle.controller(*jnp.exp(logs)))
            plan = controller.prepare(self.reference)
            found = attacked_peaks(
                unlimited(self.plant), controller, plan, self.reference, worst, LIMIT
            )
            return jnp.stack(found), found

        return jax.jacfwd(attacked, has_aux=True)(logs)


@pytest.fixture(scope="module")
def lap(reference_circle):
    return Lap(reference_circle)


@pytest.mark.slow
def test_values_and_gradient_of_the_circle(lap):
    values, worst = lap.worst(lap.start)
    slopes, attacked = lap.slopes(lap.start, worst)
    np.testing.assert_allclose(attacked, values, rtol=1e-9)
    h = 1e-4
    differences = np.stack(
        [
            (np.array(lap.worst(lap.start + h * step)[0]) - lap.worst(lap.start - h * step)[0])
            / (2 * h)
            for step in np.eye(3)
        ],
        axis=1,
    )
    size = np.abs(differences).max(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes / size, differences / size, atol=1e-6)


@pytest.mark.slow
def test_the_value_is_that_of_the_certificate(lap):
    """On a circle nothing lies between the three places along the tangent."""
    values, _ = lap.worst(lap.start)
    controller = lap.circle.controller(*jnp.exp(lap.start))
    found = certificate(lap.plant, controller, lap.reference, lap.box)
    assert values.error == pytest.approx(found.bound[slice(*LAST_LAP)].max(), rel=1e-5)
    assert values.control_use == pytest.approx(found.control.max() / LIMIT[0], rel=1e-9)


def test_a_window_without_a_sample_is_told(reference_circle, random_loop):
    with pytest.raises(ValueError, match="window: no scored sample is left"):
        worst_case(
            random_loop(0, 5), reference_circle.reference, Box.of(1.0, 1.0, 2, 1), LIMIT, (5, 5)
        )
