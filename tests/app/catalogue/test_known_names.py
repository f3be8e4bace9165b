"""A question about a name is answered before anything heavy is imported."""

import subprocess
import sys

import pytest

from jcontour.app.catalogue.known_names import FIRST_LINES, check_flags
from jcontour.app.flags.loops import Learn, Precompensate, Simulate
from jcontour.app.flags.tuning import Front, Sweep, Tune

SCRIPT = """
import sys
from jcontour.app.cli import main
code = main(sys.argv[1:])
heavy = {"jax", "mujoco", "scipy", "matplotlib", "xarray"} & set(sys.modules)
assert not heavy, heavy
sys.exit(code)
"""


def slow(*case):
    """A case for the slow tests: each starts a process of its own."""
    return pytest.param(*case, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["list"], 0, "contouring-lq"),
        (["simulate", "nosuch.ngc"], 2, "nosuch.ngc: cannot be read"),
        slow(["simulate", "spiral"], 2, "none named 'spiral'"),
        slow(["tune", "--plant", "lathe"], 2, "none named 'lathe'"),
        slow(["tune", "--controller", "magic"], 2, "none named 'magic'"),
    ],
)
def test_names_are_answered_without_anything_heavy(arguments, code, says):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *arguments], capture_output=True, text=True
    )
    assert done.returncode == code, done.stderr
    assert says in (done.stderr if code else done.stdout)


@pytest.mark.parametrize("command", ["tune", slow("simulate")])
@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("part.ngc", "G1 Q7 F100\n", "part.ngc: line 1: unknown word 'Q7'"),
        slow("part.ngc", "G1 X1\n", "part.ngc: line 1: a cutting move without a feed"),
        ("part.csv", "0,0\n1,a\n", "part.csv: line 2: needs two or three numbers"),
    ],
)
def test_a_fault_of_a_part_is_told_without_anything_heavy(tmp_path, command, name, text, says):
    (tmp_path / name).write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, command, str(tmp_path / name)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"jcontour: {tmp_path / says.partition(':')[0]}: line ")
    assert done.stderr.count("\n") == 1
    assert says in done.stderr


@pytest.mark.parametrize(
    ("flags", "text"),
    [
        ({}, "G1 X1 F100\nX2\n"),
        ({"feed_mm_per_min": 600.0}, "G1 X1\n"),  # the flag is its feed
        ({}, "G18 F100\nG2 X1 Z1 R1\n"),  # right on three axes
        ({}, "G1 X1 F100\nM30\nQ7\n"),  # after the end
        ({}, "G1 X1 F100\n" * FIRST_LINES + "Q7\n"),  # told when the whole is read
    ],
)
def test_parts_that_may_be_right_pass(tmp_path, flags, text):
    (tmp_path / "part.ngc").write_text(text)
    check_flags(Tune(parts=(str(tmp_path / "part.ngc"),), **flags))


@pytest.mark.parametrize(
    "flags",
    [
        Simulate(plant="gantry", controller="scheduled-lq", contour="ring-left"),
        Simulate(controller="mpcc"),
        Tune(parts=("circle", "cam")),
    ],
)
def test_known_names_pass(flags):
    check_flags(flags)


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (Tune(parts=("circle", "none.csv")), "none.csv: cannot be read"),
        (Simulate(plant="none.json"), "none.json: cannot be read.*jcontour machine --example FILE"),
        (Simulate(plant="lathe"), "none named 'lathe'.*jcontour machine --example FILE"),
        (Simulate(plant="xy"), "give bridgeport, xy-table, emps, flexible-axis"),
        (Tune(controller="pid"), "give one of contouring-lq, "),
    ],
)
def test_unknown_names_are_refused(flags, says):
    with pytest.raises(ValueError, match=says):
        check_flags(flags)


@pytest.mark.parametrize("kind", [Simulate, Precompensate, Learn, Tune, Front, Sweep])
@pytest.mark.parametrize("given", [{"jerk": 50.0}, {"corner_tolerance_um": 0.0}])
def test_flags_of_the_jerk_limited_law_are_refused_with_the_other_one(kind, given):
    (name,) = given
    check_flags(kind(**given))
    check_flags(kind(feed_law="trapezoidal"))
    with pytest.raises(ValueError, match=f"^{name.replace('_', '-')}: .*trapezoidal has none"):
        check_flags(kind(feed_law="trapezoidal", **given))


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (Simulate(plant="bridgport"), "'bridgport'; perhaps you meant bridgeport; give"),
        (Simulate(contour="cirle"), "'cirle'; perhaps you meant circle; give"),
        (Tune(controller="contouring-lqr"), "perhaps you meant contouring-lq; give one of"),
        (Tune(controller="scheduled-ql"), "perhaps you meant scheduled-lq; give"),  # an alias
    ],
)
def test_a_misspelt_name_is_told_with_the_nearest_one(flags, says):
    with pytest.raises(ValueError, match=says):
        check_flags(flags)


def test_a_name_far_from_all_is_told_without_a_guess():
    with pytest.raises(ValueError, match="none named 'lathe'; give bridgeport"):
        check_flags(Simulate(plant="lathe"))


def test_a_folder_in_place_of_a_part_is_told(tmp_path):
    with pytest.raises(ValueError, match="is a folder, no contour; .* take the folder of a run"):
        check_flags(Tune(parts=(str(tmp_path),)))


@pytest.mark.parametrize("flag", ["plant", "controller"])
def test_a_file_that_is_no_python_file_is_told(tmp_path, flag):
    (tmp_path / "mine.txt").write_text("class PD:\n    pass\n")
    with pytest.raises(ValueError, match=f"^{flag}: .*/mine.txt does not end in .py: .* FILE.py"):
        check_flags(Simulate(**{flag: f"{tmp_path}/mine.txt:PD"}))


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1,nan", "", "two"])
@pytest.mark.parametrize("kind", [Simulate, Precompensate, Learn, Tune, Front, Sweep])
def test_weights_that_are_no_finite_numbers_are_refused(kind, value):
    with pytest.raises(ValueError, match=f"weights: needs .* finite numbers, received 'a={value}'"):
        check_flags(kind(weights=("b=2", f"a={value}")))


def test_values_of_a_sweep_need_to_be_finite():
    with pytest.raises(ValueError, match="vary: needs .* finite numbers, received 'a=1,inf'"):
        check_flags(Sweep(vary=("a=1,inf",)))
