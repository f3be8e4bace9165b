"""A function that Numba compiles, called from programs of XLA."""

import os

import jax
import jax.numpy as jnp
import numpy as np
from numpy import intp

from jcontour.native.calls import argument, asks, drop_stale, extent, native_call, result


@native_call("jcontour_test_rows")
def _rows(frame):  # sums of rows, and for each of them its number of columns
    if asks(frame):
        return 0
    x, columns = argument(frame, intp(0)), extent(frame, intp(0), intp(1))
    sums, lengths = result(frame, intp(0)), result(frame, intp(1))
    for k in range(len(sums)):
        lengths[k] = columns
        sums[k] = 0.0
        for j in range(columns):
            sums[k] += x[k * columns + j]
    return 0


def summed(x):
    shape = jax.ShapeDtypeStruct(x.shape[:1], jnp.float64)
    return _rows([shape, shape], x)


def test_a_call_alone_in_a_batch_and_in_a_batch_of_batches():
    x = jnp.asarray(np.random.default_rng(0).standard_normal((3, 2, 4, 5)))
    for function, numbers in (
        (summed, x[0, 0]),
        (jax.vmap(summed), x[0]),
        (jax.vmap(jax.vmap(summed)), x),
    ):
        sums, lengths = jax.jit(function)(numbers)
        np.testing.assert_allclose(sums, numbers.sum(axis=-1), atol=1e-14)
        np.testing.assert_array_equal(lengths, np.full(numbers.shape[:-1], 5.0))


def test_a_batch_of_one_argument_alone():
    def scaled(factor, x):
        return summed(factor * x)[0]

    x = jnp.arange(6.0).reshape(2, 3)
    found = jax.vmap(scaled, in_axes=(0, None))(jnp.array([1.0, -2.0]), x)
    np.testing.assert_allclose(found, [[3.0, 12.0], [-6.0, -24.0]])


def test_what_was_compiled_before_a_source_changed_is_dropped(tmp_path):
    source, kept = tmp_path / "one.py", tmp_path / "__pycache__" / "one.f-1.nbi"
    kept.parent.mkdir()
    source.write_text(""), kept.write_text("")
    os.utime(source, (1000, 1000))
    os.utime(kept, (2000, 2000))
    drop_stale(tmp_path, source)
    assert kept.exists()
    os.utime(source, (3000, 3000))
    drop_stale(tmp_path, source)
    assert not kept.exists()


def test_code_that_vanishes_meanwhile_is_no_fault(tmp_path):
    source, kept = tmp_path / "a.py", tmp_path / "__pycache__" / "a.nbi"
    source.write_text("")
    kept.parent.mkdir()
    kept.symlink_to(tmp_path / "gone")  # found, and then not there
    drop_stale(tmp_path, source)
