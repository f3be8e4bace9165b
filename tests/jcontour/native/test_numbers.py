"""Arithmetic that becomes instructions, against NumPy, with numbers that are none."""

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.native.calls import straight_call
from jcontour.native.numbers import WIDTH, Whole
from jcontour.native.straight_line import whole

INF = float("inf")
# of two numbers
ARITHMETIC = [
    lambda a, b: a + b,
    lambda a, b: 2 - a,
    lambda a, b: 0.0 - a,
    lambda a, b: a * 0.5 - b * 1.0,
    lambda a, b: 1 / a + b / 3.0,
    lambda a, b: abs(-a) ** 3,
]
COMPARISONS = [
    lambda a, b: a < b,
    lambda a, b: (a <= 0.5) | (b > 1.0),
    lambda a, b: ~((a >= b) & (abs(b) < INF)) & True,
]


def written(builder, arguments, results):
    a, b = (arguments(k).lanes(0) for k in range(2))
    rows = [operation(a, b) for operation in ARITHMETIC]
    rows += [operation(a, b).chosen(a, 7.0) for operation in COMPARISONS]
    rows += [a.larger(b), a.smaller(0.5), abs(a).root()]
    for k, row in enumerate(rows):
        results(0).write(WIDTH * k, row)
    found = builder.uitofp((a > 1e3).anywhere(), results(0).one(0).type)
    results(1).write_one(0, found)
    place = 3 * (Whole(builder, arguments(0).extent(0)) + 1) + Whole(builder, whole(2), 5)
    results(1).write_one(
        1, builder.sitofp(builder.add(place.value, whole(place.added)), found.type)
    )


def test_arithmetic_comparisons_and_counting():
    random = np.random.default_rng(0)
    a, b = random.standard_normal((2, WIDTH))
    a[2], b[3], a[4], b[5] = np.nan, np.nan, np.inf, -np.inf
    count = len(ARITHMETIC) + len(COMPARISONS) + 3
    shapes = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in ((count, WIDTH), (2,))]
    call = straight_call("jcontour_test_numbers", written)
    found, others = jax.jit(lambda *ab: call(shapes, *ab))(a, b)
    with np.errstate(invalid="ignore"):
        wanted = [operation(a, b) for operation in ARITHMETIC]
        wanted += [np.where(operation(a, b), a, 7.0) for operation in COMPARISONS]
        wanted += [np.maximum(a, b), np.minimum(a, 0.5), np.sqrt(np.abs(a))]
    np.testing.assert_allclose(found, wanted, rtol=1e-14)
    np.testing.assert_array_equal(others, [1.0, 3 * (WIDTH + 1) + 7])


def test_what_is_known_costs_nothing():
    def write(builder, arguments, results):
        a = arguments(0).lanes(0)
        before = len(builder.block.instructions)
        assert a + 0.0 is a and a * 1.0 is a and a * 0.0 == 0.0 and 0 + a is a
        assert (a < 1.0).chosen(2.0, 2.0) == 2.0 and (False & (a < 1.0)) is False
        assert len(builder.block.instructions) == before + 2  # the comparisons
        results(0).write(0, a)

    shape = [jax.ShapeDtypeStruct((WIDTH,), jnp.float64)]
    a = np.arange(8.0)
    np.testing.assert_array_equal(straight_call("jcontour_test_known", write)(shape, a)[0], a)
