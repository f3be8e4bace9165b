"""Programs that XLA calls by a name."""

import time
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.native import calls
from jcontour.native.calls import shared_call, straight_call
from jcontour.native.straight_line import counted, whole


def parts(builder, arguments, results):
    return results(0).size()


def row_sum(builder, k, arguments, results):
    """Sum of a row, and how many columns it has."""
    x, found = arguments(0), results(0)
    columns = builder.sdiv(x.size(), found.size())

    def add(j, carried):
        place = builder.add(builder.mul(k, columns), j)
        return [builder.fadd(carried[0], x.one(place))]

    begun = [x.one(whole(0)).type(0.0)]
    found.write_one(k, counted(builder, columns, add, begun)[0])


def summed(x):
    shape = [jax.ShapeDtypeStruct(x.shape[:1], jnp.float64)]
    return shared_call("jcontour_test_rows", parts, row_sum)(shape, x)[0]


def test_a_call_alone_in_a_batch_and_in_a_batch_of_batches():
    x = np.random.default_rng(0).standard_normal((3, 2, 4, 5))
    for function, numbers in (
        (summed, x[0, 0]),
        (jax.vmap(summed), x[0]),
        (jax.vmap(jax.vmap(summed)), x),
    ):
        found = jax.jit(function)(numbers)
        np.testing.assert_allclose(found, numbers.sum(axis=-1), atol=1e-14)


def test_a_batch_of_one_argument_alone():
    x = np.arange(6.0).reshape(2, 3)
    scaled = jax.jit(jax.vmap(lambda factor, x: summed(factor * x), (0, None)))
    found = scaled(np.array([1.0, -2.0]), x)
    np.testing.assert_allclose(found, [[3.0, 12.0], [-6.0, -24.0]])


def written(builder, arguments, results):
    results(0).write_one(0, arguments(0).one(0))


def test_threads_that_meet_compile_once(monkeypatch):
    """XLA holds the address of what was compiled first: a second one would free it."""
    compiled, count = calls._engine, []

    def slowly(text):
        count.append(text)
        time.sleep(0.2)
        return compiled(text)

    monkeypatch.setattr(calls, "_engine", slowly)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: straight_call("jcontour_test_met", written), range(4)))
    assert len(count) == 1 and len(found) == 4
