"""A question about a name is answered before anything heavy is imported."""

import subprocess
import sys

import pytest

from experiments.catalogue.known_names import check_flags
from experiments.options import Simulate, Trace, Tune

SCRIPT = """
import sys
from experiments.cli import main
code = main(sys.argv[1:])
heavy = {"jax", "jcontour", "mujoco", "scipy", "matplotlib", "xarray"} & set(sys.modules)
assert not heavy, heavy
sys.exit(code)
"""


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["list"], 0, "contouring-lq"),
        (["simulate", "nosuch.ngc"], 2, "nosuch.ngc: cannot be read"),
        (["simulate", "spiral"], 2, "none named 'spiral'"),
        (["tune", "--plant", "lathe"], 2, "none named 'lathe'"),
        (["tune", "--controller", "magic"], 2, "none named 'magic'"),
    ],
)
def test_names_are_answered_without_anything_heavy(arguments, code, says):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *arguments], capture_output=True, text=True
    )
    assert done.returncode == code, done.stderr
    assert says in (done.stderr if code else done.stdout)


@pytest.mark.parametrize(
    "flags",
    [
        Simulate(plant="gantry", controller="scheduled-lq", contour="ring-left"),
        Trace(),
        Tune(parts=("circle", "cam")),
    ],
)
def test_known_names_pass(flags):
    check_flags(flags)


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (Tune(parts=("circle", "none.csv")), "none.csv: cannot be read"),
        (Simulate(plant="none.json"), "none.json: cannot be read"),
        (Simulate(plant="xy"), "give bridgeport, xy-table, flexible-axis"),
        (Tune(controller="pid"), "give one of contouring-lq, "),
    ],
)
def test_unknown_names_are_refused(flags, says):
    with pytest.raises(ValueError, match=says):
        check_flags(flags)
