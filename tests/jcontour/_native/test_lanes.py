"""Eight numbers as one value, against NumPy; and what Numba keeps."""

import os
import time

import numba
import numpy as np

from jcontour._native.lanes import (
    WIDTH,
    drop_stale,
    fma,
    load,
    root,
    spread,
    store,
    where_less,
)


@numba.njit
def _worked_out(a, b, out):
    one, other, half = load(a, 0), load(b, 0), spread(0.5)
    store(out, 0, one + other)
    store(out, 1, one - other)
    store(out, 2, one * other)
    store(out, 3, one / other)
    store(out, 4, root(one))
    store(out, 5, fma(one, other, half))
    store(out, 6, where_less(one, other, half, one))


def test_arithmetic_with_numbers_that_are_none():
    random = np.random.default_rng(0)
    a, b, out = random.uniform(0.1, 2, WIDTH), random.uniform(0.1, 2, WIDTH), np.zeros(7 * WIDTH)
    a[3], b[5] = np.nan, np.nan
    _worked_out(a, b, out)
    with np.errstate(invalid="ignore"):
        wanted = [a + b, a - b, a * b, a / b, np.sqrt(a), a * b + 0.5, np.where(a < b, 0.5, a)]
    np.testing.assert_allclose(out.reshape(7, WIDTH), wanted, rtol=1e-15)


def test_what_was_compiled_before_a_source_changed_is_dropped(tmp_path):
    source, kept = tmp_path / "one.py", tmp_path / "__pycache__" / "one.f-1.nbi"
    kept.parent.mkdir()
    source.write_text(""), kept.write_text("")
    now = time.time()  # what says how to compile is a source, too, and older than this
    os.utime(source, (now, now + 1000))
    os.utime(kept, (now, now + 2000))
    drop_stale(tmp_path, source)
    assert kept.exists()
    os.utime(source, (now, now + 3000))
    drop_stale(tmp_path, source)
    assert not kept.exists()
    kept.write_text("")
    os.utime(source, (1000, 1000)), os.utime(kept, (2000, 2000))
    drop_stale(tmp_path, source)  # kept before `compiled` was as it is
    assert not kept.exists()


def test_code_that_vanishes_meanwhile_is_no_fault(tmp_path):
    source, kept = tmp_path / "a.py", tmp_path / "__pycache__" / "a.nbi"
    source.write_text("")
    kept.parent.mkdir()
    kept.symlink_to(tmp_path / "gone")  # found, and then not there
    drop_stale(tmp_path, source)
