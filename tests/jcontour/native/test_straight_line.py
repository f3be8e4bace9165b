"""Programs that arithmetic in Python writes, against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.native.calls import straight_call
from jcontour.native.numbers import WIDTH
from jcontour.native.straight_line import counted, counted_down, memory, whole


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
    found, total = jax.jit(called)(x, np.array([7.0, 0.5]))
    np.testing.assert_allclose(found, 2 / (0.5 * x - 3) + x, rtol=1e-14)
    np.testing.assert_allclose(total, x.reshape(5, WIDTH).sum(axis=0), atol=1e-14)


def test_a_loop_of_nothing_and_one_member_after_the_other():
    nothing, total = jax.jit(called)(np.zeros(0), np.ones(2))
    assert nothing.shape == (0,)
    np.testing.assert_array_equal(total, np.zeros(WIDTH))
    x = np.random.default_rng(1).standard_normal((3, 2 * WIDTH))
    found, _ = jax.jit(jax.vmap(called, (0, None)))(x, np.ones(2))
    np.testing.assert_allclose(found, 2 / (x - 3) + x, rtol=1e-14)


def test_a_loop_carries_numbers_and_counts_either_way():
    """Over the k of an array, x of k and the number carried: 2 c + x."""

    def write(builder, arguments, results):
        x = arguments(0)
        for place, down in enumerate((False, True)):

            def step(k, carried):
                return [builder.fadd(builder.fadd(carried[0], carried[0]), x.one(k))]

            begun = [x.one(0).type(1.0)]
            results(0).write_one(place, counted(builder, x.size(), step, begun, down)[0])

    shape = [jax.ShapeDtypeStruct((2,), jnp.float64)]
    x = np.array([[3.0, 5.0], [7.0, 11.0]])
    up, down = np.asarray(straight_call("jcontour_test_carried", write)(shape, x)[0])
    assert up == 16 + 8 * 3 + 4 * 5 + 2 * 7 + 11 and down == 16 + 8 * 11 + 4 * 7 + 2 * 5 + 3
