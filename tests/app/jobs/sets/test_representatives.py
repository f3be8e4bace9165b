"""Stretches of a long program: where they come from, and what they keep of it."""

import numpy as np
import pytest

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.jobs.entry import ENTRY
from jcontour.app.jobs.job import Pace, from_file
from jcontour.app.jobs.sets import representatives as module
from jcontour.app.jobs.sets.representatives import WINDOW, representatives
from jcontour.app.jobs.sets.stretches import between
from jcontour.geometry.contours import circle, polygon

DT = 0.5e-3


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """Long straight lines, and one zigzag of 40 corners in the middle; 12 s at 3 m/min."""
    zigzag = [f"G1 X{150 + 0.5 * k} Y{1.0 if k % 2 else 0.0}" for k in range(1, 41)]
    lines = ["G0 X0 Y0", "G1 X150 Y0 F3000", *zigzag, "G1 X170 Y300", "G1 X400 Y300", "M2"]
    path = tmp_path_factory.mktemp("long") / "part.ngc"
    path.write_text("\n".join(lines) + "\n")
    return from_file(path, Pace(machine_named("bridgeport"), None, None))


def test_stretches_are_samples_of_the_program_in_motion(program):
    found = representatives(program, DT)
    assert program.samples > module.LONG and 2 <= len(found) <= module.COUNT
    whole = np.asarray(program.reference(DT, 5).position)
    for one in found:
        reference = one.reference(DT, 5)
        position = np.asarray(reference.position)[:WINDOW]
        apart = np.linalg.norm(whole[:, None] - position[:1], axis=-1).ravel()
        first = int(np.argmin(apart))
        np.testing.assert_allclose(position, whole[first : first + WINDOW], atol=1e-9)
        assert np.linalg.norm(reference.start_increment) > 0
        assert not one.scored[:ENTRY].any() and one.scored[ENTRY:].any()


def test_the_hardest_part_is_among_them(program):
    found = representatives(program, DT)
    x = [np.asarray(one.reference(DT, 0).position)[:, 0] for one in found]
    assert any(((150e-3 < one) & (one < 170e-3)).sum() > 100 for one in x)


def test_straight_lines_of_one_direction_need_no_second_stretch(program):
    """They are alike: what is farthest from those chosen comes next, and likeness comes last."""
    features = np.array([[1.0, 0.0], [0.2, 0.0], [0.2, 0.0], [0.2, 1.0]])
    assert module._spread(features, 4) == [0, 3, 1]


def test_what_is_not_long_stays_as_it_is():
    job = job_named("cam", Pace(machine_named("bridgeport"), None, None))
    assert representatives(job, DT) == [job]


def test_a_stretch_of_a_contour_is_the_same_curve():
    for contour in (circle(3e-3), polygon([[0.0, 0.0], [4e-3, 0.0], [4e-3, 2e-3]])):
        length = float(contour.length)
        low, high = 0.23 * length, 0.81 * length
        part = between(contour, low, high)
        assert float(part.length) == pytest.approx(high - low, rel=1e-12)
        s = np.linspace(0.0, high - low, 57)
        found, wanted = np.asarray(part.position(s)), np.asarray(contour.position(low + s))
        np.testing.assert_allclose(found, wanted, atol=1e-15)
        assert not bool(part.closed)


@pytest.mark.parametrize(("low", "high"), [(-1.0, 1.0), (1e-3, 1e-3), (0.0, 1.0)])
def test_a_stretch_that_is_none_is_named(low, high):
    with pytest.raises(ValueError, match="low, high: needs 0 <= low < high"):
        between(circle(3e-3), low, high)
