"""Problems in lanes, and back: against the order they came in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.native.calls import shared_call
from jcontour.native.numbers import WIDTH, Whole
from jcontour.native.side_by_side import Column, Eight, with_memory
from jcontour.native.straight_line import counted, whole

SIZE = 3


def count(builder, arguments):
    return builder.sdiv(arguments(0).size(), whole(SIZE))


def groups(builder, arguments, _):
    return builder.sdiv(builder.add(count(builder, arguments), whole(WIDTH - 1)), whole(WIDTH))


def turned(builder, group, arguments, results):
    """Twice the numbers of each problem, the last one first."""
    eight = Eight.of(builder, group, count(builder, arguments))

    def work(memory):
        behind = Column.at(builder, memory, SIZE)
        for k in range(SIZE):
            Column.at(builder, memory, 0)[k] = eight.gathered(arguments(0), SIZE, whole(k))

        def turn(k, _):
            behind[Whole(builder, k, 0)] = (
                2.0
                * Column.at(builder, memory, 0)[Whole(builder, builder.sub(whole(0), k), SIZE - 1)]
            )
            eight.scatter(results(0), SIZE, k, behind[Whole(builder, k)])

        counted(builder, whole(SIZE), turn)

    with_memory(builder, 2 * SIZE, work, lambda: None)


@pytest.mark.parametrize("shape", [(1,), (8,), (11,), (2, 9), (0,)])
def test_each_problem_keeps_its_place(shape):
    x = np.random.default_rng(0).standard_normal((*shape, SIZE))
    result = [jax.ShapeDtypeStruct((SIZE,), jnp.float64)]
    call = shared_call("jcontour_test_turned", groups, turned)

    def one(x):
        return call(result, x)[0]

    for _ in shape:
        one = jax.vmap(one)
    np.testing.assert_array_equal(jax.jit(one)(x), 2 * x[..., ::-1])
