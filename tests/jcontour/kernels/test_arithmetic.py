import jax.numpy as jnp

from jcontour.kernels.arithmetic import dot


def test_sums_of_products():
    assert (
        dot([]) == 0.0
        and dot([(0.0, jnp.nan), (2.0, 3.0)]) == 6.0
        and dot([(2.0, 3.0), (4.0, 5.0)]) == 26.0
        and dot([(2.0, 3.0)], 1.0) == 7.0
    )
