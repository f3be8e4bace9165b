"""Work that XLA's threads share: every part is done once, by more than one of them."""

import os
from threading import Thread

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.native import calls, interface
from jcontour.native.calls import alone, shared_call
from jcontour.native.numbers import DOUBLE, INT, LONG, known
from jcontour.native.straight_line import whole


def parts(builder, arguments, _):
    return arguments(0).size()


def one(builder, k, arguments, results):
    """Write x + 1 and the thread that found it; count the part in memory of the test's own."""
    number = builder.fadd(arguments(0).one(k), DOUBLE(1.0))
    results(0).write_one(k, number)
    thread = builder.call(known(builder, "pthread_self", LONG), [])
    results(1).write_one(k, builder.uitofp(builder.urem(thread, whole(2**52)), DOUBLE))
    counts = builder.fptoui(arguments(1).one(0), LONG)
    place = builder.add(counts, builder.mul(k, whole(8)))
    pointer = builder.inttoptr(place, LONG.as_pointer())
    builder.atomic_rmw("add", pointer, whole(1), "seq_cst")
    builder.call(known(builder, "usleep", INT, INT), [INT(2000)])


@jax.jit
def shared(x, counts):
    shape = jax.ShapeDtypeStruct(x.shape, jnp.float64)
    return shared_call("jcontour_test_shared", parts, one)([shape, shape], x, counts)


def slow(x):
    """x + 1, the threads, and how often each part was done."""
    counts = np.zeros(x.size, np.int64)
    found, threads = map(np.asarray, shared(x, np.array([float(counts.ctypes.data)])))
    return found, threads, counts


@pytest.mark.parametrize("count", [1, 2, 60])
def test_every_part_is_done_once(count):
    x = np.random.default_rng(0).standard_normal(count)
    found, _, counts = slow(x)
    np.testing.assert_array_equal(found, x + 1.0)
    np.testing.assert_array_equal(counts, np.ones(count))


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core")
def test_more_than_one_thread_helps():
    threads = set(slow(np.zeros(100))[1])
    assert 2 <= len(threads) <= len(os.sched_getaffinity(0)) and not alone()


def test_calls_that_share_at_once_do_not_wait_for_each_other_without_end():
    """From threads of their own: calls of one program run one after the other."""
    found = {}

    def call(k):
        found[k] = slow(np.full(20, k))[0]

    threads = [Thread(target=call, args=(float(k),), daemon=True) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=60)
    assert sorted(found) == [0.0, 1.0, 2.0, 3.0]
    for k, numbers in found.items():
        np.testing.assert_array_equal(numbers, np.full(20, k + 1.0))


def test_an_interface_that_is_not_known_is_told(monkeypatch):
    slow(np.zeros(2))
    assert not alone()
    monkeypatch.setattr(interface, "LAYOUTS", range(99, 100))  # the calls have seen another
    assert alone()
    monkeypatch.setattr(calls, "_KEPT", {})
    assert not alone()
