"""Gradient of a certificate: against central differences of the certificate itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.geometry.contours import line
from jcontour.guarantees.certified_gradient import attacked_error, worst_projected_error
from jcontour.motion.references import along

LAST_LAP = (504, 756)


@pytest.mark.slow
def test_the_gradient_by_the_weights(reference_circle):
    row = reference_circle.rows[0]
    _, box = reference_circle.of(row)
    plant, reference = reference_circle.plant, reference_circle.reference
    start = jnp.log(jnp.array([row["alpha"], row["beta"], row["rho"]]))

    def worst(logs):
        controller = reference_circle.controller(*jnp.exp(logs))
        return worst_projected_error(plant, controller, reference, box, LAST_LAP)

    found = worst(start)

    def attacked(logs):
        controller = reference_circle.controller(*jnp.exp(logs))
        return attacked_error(plant, controller, reference, found)

    value, gradient = jax.jit(jax.value_and_grad(attacked))(start)
    assert found.bound == pytest.approx(row["certified_m"], rel=1e-8)
    assert value == pytest.approx(found.bound, rel=1e-9)
    h = 1e-4
    differences = [
        (worst(start + h * step).bound - worst(start - h * step).bound) / (2 * h)
        for step in np.eye(3)
    ]
    assert np.asarray(gradient) == pytest.approx(np.array(differences), abs=1e-6 * 0.5e-6)


@pytest.mark.slow
def test_bad_windows_and_axes_are_told(reference_circle):
    row = reference_circle.rows[0]
    controller, box = reference_circle.of(row)
    plant, reference = reference_circle.plant, reference_circle.reference
    with pytest.raises(ValueError, match="window: no scored sample is left"):
        worst_projected_error(plant, controller, reference, box, (5, 5))


def test_a_reference_of_one_axis_is_told(reference_circle):
    reference = along(line([0.0], [1.0]), [0.0, 0.1], 1e-3, 1, at_rest=False)
    controller, box = reference_circle.of(reference_circle.rows[0])
    with pytest.raises(ValueError, match="reference: a normal needs two axes"):
        worst_projected_error(reference_circle.plant, controller, reference, box)
