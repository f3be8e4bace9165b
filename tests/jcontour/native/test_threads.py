"""Work that XLA's threads share: every part is done once, by more than one of them."""

import os
from threading import Thread

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numba import types
from numpy import intp

from jcontour.native.calls import argument, asks, native_call, result
from jcontour.native.threads import (
    done,
    frame_of,
    is_work,
    leave,
    next_part,
    own_address,
    shared_work,
)

sleep = types.ExternalFunction("usleep", types.int32(types.int32))
thread = types.ExternalFunction("pthread_self", types.intp())


@native_call("jcontour_test_shared")
def _slow(address):  # x + 1, number by number, and the thread that found it
    first = not is_work(address)
    work = address
    if first:
        if asks(address):
            return 0
        x = argument(address, intp(0))
        for k in range(len(x)):
            result(address, intp(0))[k] = 0.0
        work = shared_work(address, len(x), own_address())
    at = next_part(work)
    while at >= 0:
        frame = frame_of(work)
        result(frame, intp(0))[at] += argument(frame, intp(0))[at] + 1.0
        result(frame, intp(1))[at] = thread() % 2**52
        sleep(2000)
        done(work)
        at = next_part(work)
    leave(work, first)
    return 0


@jax.jit
def slow(x):
    shape = jax.ShapeDtypeStruct(x.shape, jnp.float64)
    return _slow([shape, shape], x)


@pytest.mark.parametrize("parts", [1, 2, 60])
def test_every_part_is_done_once(parts):
    x = np.random.default_rng(0).standard_normal(parts)
    np.testing.assert_array_equal(slow(jnp.asarray(x))[0], x + 1.0)


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core")
def test_more_than_one_thread_helps():
    threads = set(np.asarray(slow(jnp.zeros(100))[1]))
    assert 2 <= len(threads) <= len(os.sched_getaffinity(0))


def test_calls_that_share_at_once_do_not_wait_for_each_other_without_end():
    """From threads of their own: calls of one program run one after the other."""
    found = {}

    def call(k):
        found[k] = np.asarray(slow(jnp.full(20, k))[0])

    calls = [Thread(target=call, args=(float(k),), daemon=True) for k in range(4)]
    for one in calls:
        one.start()
    for one in calls:
        one.join(timeout=60)
    assert sorted(found) == [0.0, 1.0, 2.0, 3.0]
    for k, numbers in found.items():
        np.testing.assert_array_equal(numbers, np.full(20, k + 1.0))
