"""Advice on another tolerance: what is printed is what a motion within it takes."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from jcontour.app import machines
from jcontour.app.catalogue.choices import machine_named
from jcontour.app.jobs.job import from_file
from jcontour.app.jobs.pace import Pace

EXAMPLE = str(Path(machines.__file__).parent / "example.json")
PACE = Pace(machine_named(EXAMPLE), None, None)


@pytest.fixture
def circle(tmp_path):
    """A circle of 20 mm in 200 chords with a sagitta of 2.5 um, and what is said of a motion."""
    angle = np.linspace(0.0, 2 * math.pi, 201)
    x, y = np.round([20 * np.cos(angle), 20 * np.sin(angle)], 3)
    moves = [f"G1 X{a:.3f} Y{b:.3f}" for a, b in zip(x, y, strict=True)]
    path = tmp_path / "circle.ngc"

    def read(tolerance, begin=""):
        path.write_text("\n".join(["G21 F6000", begin, "G0 X20", *moves]))
        job = from_file(path, PACE._replace(corner_tolerance=tolerance))
        assert job.planned is not None
        return job.planned, job.doubts

    return read


def test_the_next_step_is_told_with_what_it_takes(circle):
    near, (told,) = circle(2e-6)
    far, silent = circle(5e-6)
    assert silent == ()
    flag, takes, before = re.findall(r"um ([0-9.]+) takes ([0-9.]+) s, not ([0-9.]+) s", told)[0]
    assert flag == "5" and told.startswith("the tolerance of 2 um limits 9")
    assert float(takes) == pytest.approx(far.duration, abs=1e-3)
    assert float(before) == pytest.approx(near.duration, abs=1e-3)
    assert far.duration < 0.5 * near.duration


def test_what_a_program_allows_is_tried_before_it_is_advised(circle):
    (told,) = circle(2e-6, "G64 P0.005")[1]
    assert "allows 5 um (P of G64), 2 um are used: --corner-tolerance-um 5 takes 1.3" in told
    (told,) = circle(5e-6, "G64 P0.1")[1]
    assert told.endswith("more would save no time") and "--corner-tolerance-um" not in told
