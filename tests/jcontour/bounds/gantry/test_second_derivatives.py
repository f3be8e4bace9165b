"""Enclosures of slopes and bends against derivatives by JAX, all over their boxes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.bounds.gantry.second_derivatives import enclosures


def bent(x):
    """Every operation that has a rule."""
    a, b, c = x
    turned = jnp.stack([jnp.sin(a) * b - c, jnp.cos(b) / (2.0 + c**2)])
    return jnp.concatenate([turned, -jnp.square(turned[:1]) + 3.0 * a])


def test_slopes_and_bends_over_a_box_are_enclosed():
    random = np.random.default_rng(4)
    middle, width = random.uniform(-1, 1, (6, 3)), random.uniform(0.01, 0.2, (6, 3))
    found = enclosures(bent, middle - width, middle + width)
    points = middle + width * random.uniform(-1, 1, (20, 6, 3))
    for derivative, part in ((lambda f: f, "value"), (jax.jacfwd, "slope"), (jax.hessian, "bend")):
        exact = np.array(jax.jit(jax.vmap(jax.vmap(derivative(bent))))(points))
        for i, one in enumerate(found):
            inside = getattr(one, part)
            assert np.all(inside.low <= exact[:, :, i] + 1e-12)
            assert np.all(exact[:, :, i] <= inside.high + 1e-12)


def test_boxes_of_one_point_give_the_derivatives_themselves():
    x = np.random.default_rng(5).uniform(-1, 1, (4, 3))
    bends = np.array(jax.jit(jax.vmap(jax.hessian(bent)))(x))
    for i, one in enumerate(enclosures(bent, x, x)):
        assert one.bend.low == pytest.approx(bends[:, i], abs=1e-12)
        assert one.bend.high == pytest.approx(bends[:, i], abs=1e-12)


def test_an_operation_without_a_rule_is_told():
    with pytest.raises(ValueError, match="second derivatives: exp has no rule"):
        enclosures(jnp.exp, np.zeros((1, 2)), np.ones((1, 2)))
