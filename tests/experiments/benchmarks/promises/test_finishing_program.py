"""The program against its own curve, and what CAM systems promise of theirs."""

import numpy as np
import pytest

from experiments.benchmarks.promises.finishing_program import (
    CHORD,
    LEAST,
    MOST,
    Side,
    finishing_sides,
    gcode,
)
from jcontour.geometry.toolpaths import parse_gcode

SIDES = finishing_sides(3000)


def test_passes_follow_each_other():
    for before, after in zip(SIDES[:-1], SIDES[1:], strict=True):
        np.testing.assert_allclose(after.at(np.zeros(1)), before.at(np.ones(1)), atol=1e-15)


@pytest.mark.parametrize("side", SIDES[:6])
def test_chords_stay_near_their_curve(side: Side):
    """The middle of a chord, in its parameter, is about its farthest point."""
    t = side.chords()
    ends = side.at(t)
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    assert (length > LEAST).all() and (length < 1.01 * MOST).all()
    fine = side.at(np.linspace(t[:-1], t[1:], 21).ravel()).reshape(21, -1, 2)
    along = np.diff(ends, axis=0) / length[:, None]
    apart = fine - ends[:-1]
    across = np.abs(apart[..., 0] * along[:, 1] - apart[..., 1] * along[:, 0]).max(axis=0)
    assert across.max() < 1.3 * CHORD and np.median(across) > 0.3 * CHORD


@pytest.mark.parametrize("decimals", [3, 4])
def test_the_program_is_the_same_every_time_and_read_as_it_is_meant(decimals):
    text = gcode(SIDES, decimals)
    assert text == gcode(finishing_sides(3000), decimals)
    path = parse_gcode(text).contour
    assert 3000 <= path.extent.size < 3000 + 200
    ends, step = np.asarray(path.position(path.start)), 10.0 ** (-3 - decimals)  # [m]
    np.testing.assert_allclose(ends / step, np.round(ends / step), atol=1e-6)
    np.testing.assert_allclose(ends[:50], SIDES[0].at(SIDES[0].chords())[:50], atol=0.51 * step)
