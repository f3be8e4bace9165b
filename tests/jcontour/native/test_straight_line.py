"""Programs that arithmetic in Python writes, against NumPy."""

import time
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.native import straight_line
from jcontour.native.straight_line import WIDTH, counted_down, memory, straight_call, whole


def written(builder, arguments, results):
    """For groups of eight numbers x: 2 / (x a - 3) + x, and behind it the sum of all groups."""
    x, a, found, total = arguments(0), arguments(1), results(0), results(1)
    sums = memory(builder, 1)
    sums.write(0, 0.0)

    def group(k):
        first = builder.mul(k, whole(WIDTH))
        number = x.lanes(first)
        found.write(first, 2 / (number * a.everywhere(1) - 3.0) + number)
        sums.write(0, sums.lanes(0) + -number)

    counted_down(builder, builder.sdiv(x.extent(0), whole(WIDTH)), group)
    total.write(0, -sums.lanes(0))


def called(x, a):
    shapes = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in (x.shape, (WIDTH,))]
    return straight_call("jcontour_test_written", written)(shapes, x, a)


def test_arithmetic_and_loops():
    x = np.random.default_rng(0).standard_normal(5 * WIDTH)
    found, total = jax.jit(called)(jnp.asarray(x), jnp.array([7.0, 0.5]))
    np.testing.assert_allclose(found, 2 / (0.5 * x - 3) + x, rtol=1e-14)
    np.testing.assert_allclose(total, x.reshape(5, WIDTH).sum(axis=0), atol=1e-14)


def test_a_loop_of_nothing_and_one_member_after_the_other():
    nothing, total = jax.jit(called)(jnp.zeros(0), jnp.ones(2))
    assert nothing.shape == (0,)
    np.testing.assert_array_equal(total, np.zeros(WIDTH))
    x = jnp.asarray(np.random.default_rng(1).standard_normal((3, 2 * WIDTH)))
    found, _ = jax.jit(jax.vmap(called, (0, None)))(x, jnp.ones(2))
    np.testing.assert_allclose(found, 2 / (x - 3) + x, rtol=1e-14)


def test_threads_that_meet_compile_once(monkeypatch):
    """XLA holds the address of what was compiled first: a second one would free it."""
    compiled, count = straight_line._compiled, []

    def slowly(name, write):
        count.append(name)
        time.sleep(0.2)
        return compiled(name, write)

    monkeypatch.setattr(straight_line, "_compiled", slowly)
    with ThreadPoolExecutor(4) as pool:
        calls = list(pool.map(lambda _: straight_call("jcontour_test_met", written), range(4)))
    assert len(count) == 1 and len(calls) == 4
