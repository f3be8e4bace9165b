import jax
import jax.numpy as jnp
import numpy as np

from jcontour._tracing import is_concrete


def test_numbers_and_arrays_are_concrete():
    assert is_concrete() and is_concrete(1.0, np.ones(2), jnp.ones(2), None)


def test_one_tracer_is_enough():
    seen = []

    @jax.jit
    def look(x):
        seen.append((is_concrete(x), is_concrete(1.0, x), is_concrete(1.0)))
        return x

    look(1.0)
    jax.vmap(look)(jnp.ones(2))
    assert seen[0] == (False, False, True)
    assert not is_concrete_inside_grad()


def is_concrete_inside_grad():
    actual = []
    jax.grad(lambda x: actual.append(is_concrete(x)) or x)(1.0)
    return actual[0]
