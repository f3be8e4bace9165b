"""What an exported law is tried on."""

import shutil

import numpy as np
import pytest

from jcontour.app.runs.checks.exported_code import compiled_checks, off_the_plan, rounding
from jcontour.export.affine_law import AffineLaw
from jcontour.export.drive_law import DriveLaw

PROGRAM = '#include <stdio.h>\nint main(void)\n{\n    puts("%s");\n    return 0;\n}\n'

pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="no C compiler here")


def proportional(limit=np.inf, gain=1000.0):
    """u = gain (1 + r - y) on two axes, the second of which stands still."""
    law = DriveLaw(1e-3, (), 2, 2, None, None, None, None, np.full(2, limit))
    steps = 200
    r = np.stack([np.linspace(0.1, 0.2, steps), np.full(steps, 0.3)], axis=1)
    D = np.broadcast_to(gain * np.eye(2), (steps, 2, 2))
    f = gain * (1e-3 + r)
    nothing = np.zeros((steps, 2, 0)), np.zeros((steps, 0))
    return AffineLaw(law, np.zeros(0), nothing[0], D, f, nothing[1]), r


@pytest.mark.parametrize("limit", [np.inf, 1.05])
def test_the_wave_changes_the_controls_by_a_tenth_of_the_largest(limit):
    affine, r = proportional(limit)
    _, u = affine.run(r)
    assert u == pytest.approx(1.0)
    tried = off_the_plan(affine.law, affine.plan_along(r), u)
    assert (np.ptp(tried - r, axis=0) > 1e-4).all()  # on both axes
    assert np.abs(tried - r).max() == pytest.approx(0.1 / 1000.0, rel=1e-3)
    assert affine.run(tried)[1].max() == pytest.approx(min(1.1, limit), rel=1e-3)


def test_without_feedback_the_plan_is_kept():
    affine, r = proportional(gain=0.0)
    _, u = affine.run(r)
    assert np.array_equal(off_the_plan(affine.law, affine.plan_along(r), u), r)


def test_single_precision_costs_the_rounding_of_what_is_measured():
    affine, r = proportional()
    plan = affine.plan_along(r)
    tried = off_the_plan(affine.law, plan, affine.run(r)[1])
    assert rounding(affine, plan, tried, "double") < 1e-12
    spacing = 1000.0 * np.spacing(np.float32(0.3))  # both the plan and the measurement are rounded
    assert 0.1 * spacing < rounding(affine, plan, tried, "single") < 2.0 * spacing


def test_what_a_program_says_is_read(tmp_path):
    (tmp_path / "a.c").write_text(PROGRAM % "9 samples, largest difference 2.5e-13, 81.5 ns a step")
    found = compiled_checks(tmp_path)[0]
    assert (found.difference, found.nanoseconds) == (2.5e-13, 81.5)
    assert found.compiler.startswith("gcc -std=c99 ")


@pytest.mark.parametrize("text", ["int main(void) { int unused; return 0; }\n", PROGRAM % "moon"])
def test_a_warning_or_a_strange_answer_is_a_fault(tmp_path, text):
    (tmp_path / "a.c").write_text(text)
    with pytest.raises(RuntimeError, match=r"export: (gcc failed|the program of gcc said)"):
        compiled_checks(tmp_path)
