"""Steps that are affine, and those that are not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.bounds.affine import NotAffine, check_affine

GAIN, X = np.ones((2, 2)), np.ones(2)

AFFINE = {
    "product": lambda g, x: g @ x - x / g[0, 0] + jnp.sin(g).sum(),
    "parts": lambda g, x: jnp.concatenate([x[:1], -x[1:], g[0]]).reshape(2, 2).T.sum(0),
    "line": lambda g, x: jnp.stack([x, 2 * x])[jnp.asarray(1)],
    "chosen by the plan": lambda g, x: jnp.where(g[0] > 0, x, 3 * x),
    "clip at infinity": lambda g, x: jnp.clip(x, -jnp.inf, jnp.asarray(np.inf)),
    "jit": lambda g, x: jax.jit(lambda y: g @ y)(x),
    "nonlinear in the plan": lambda g, x: jnp.linalg.inv(g + jnp.eye(2)) @ x,
}
CURVED = {
    "square": (lambda g, x: x * x, "mul"),
    "quotient": (lambda g, x: g[0] / x, "div"),
    "clip": (lambda g, x: jnp.clip(x, -1.0, 1.0), "max|min|clamp"),
    "clip by the plan": (lambda g, x: jnp.minimum(x, g[0]), "min"),
    "chosen by itself": (lambda g, x: jnp.where(x > 0, x, 0.0), "gt"),
    "rounded": (lambda g, x: jnp.round(x), "round"),
    "sine inside jit": (lambda g, x: jax.jit(jnp.sin)(x), "sin"),
    "loop": (lambda g, x: jax.lax.fori_loop(0, 3, lambda _, y: y * x, x), "scan|while"),
    "whole numbers": (lambda g, x: x.astype(int), "convert_element_type"),
}


@pytest.mark.parametrize("name", AFFINE)
def test_affine_steps_pass(name):
    check_affine(AFFINE[name], GAIN, X)


@pytest.mark.parametrize("name", CURVED)
def test_another_step_is_told_with_its_operation(name):
    function, operation = CURVED[name]
    with pytest.raises(NotAffine, match=f"not linear: ({operation})"):
        check_affine(function, GAIN, X)


def test_a_product_of_parts_that_both_move_is_told():
    with pytest.raises(NotAffine, match="dot_general"):
        check_affine(lambda _, both: both[0] @ both[1], None, (GAIN, X))
