"""The C code is compiled with every warning on, run, and compared bit by bit."""

import shutil
import subprocess
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour import contours, feed_laws, references, simulate
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.speed_by_difference import SpeedByDifference
from jcontour.export.c_code import c_header, c_plan, c_source
from jcontour.export.c_replay import Units, c_plan_reader, c_replay, plan_file, replay_file
from jcontour.export.drive_law import replayed
from jcontour.export.linear_form import linear_form
from jcontour.export.numpy_code import numpy_source
from jcontour.linear.plant import LinearPlant
from jcontour.plants import Encoders
from jcontour.sensors import Sensors, motors

STRICT = "-std=c99 -Wall -Wextra -pedantic -Werror -O2 -ffp-contract=off".split()
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
NOTES = ["machine: mill */ int x; /*", "second ??/ line \\"]

needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler here")


def written(folder, law, plan, recorded, precision="double", tables=True):
    code = c_plan(plan, "part", precision) if tables else c_plan_reader(plan)
    units = Units("control unit", ("m",) * law.measured)
    texts = {
        "controller.h": c_header(law, plan, NOTES, precision),
        "controller.c": c_source(law, plan, precision),
        "plan.c": code,
        "replay.c": c_replay(),
        "controller.py": numpy_source(law, plan, NOTES),
        "plan.csv": plan_file(law, plan, units),
        "replay.csv": replay_file(*recorded, units),
    }
    for name, text in texts.items():
        (folder / name).write_text(text)


def replayed_in_c(folder, compiler, columns):
    sources = [str(path) for path in folder.glob("*.c")]
    done = subprocess.run(
        [compiler, *STRICT, "-o", str(folder / "replay"), *sources], text=True, capture_output=True
    )
    assert done.returncode == 0, done.stderr
    words = [str(folder / "replay"), "replay.csv", "print"]
    told = subprocess.run(words, cwd=folder, text=True, capture_output=True, check=True).stdout
    *rows, last = told.splitlines()
    return np.array([row.split() for row in rows], float).reshape(-1, columns), last


def replayed_in_numpy(folder, law):
    module = {"__file__": str(folder / "controller.py"), "__name__": "controller"}
    exec(compile((folder / "controller.py").read_text(), "controller.py", "exec"), module)
    rows = np.loadtxt(folder / "replay.csv", delimiter=",", skiprows=1, ndmin=2)
    return module["replay"](module["read_plan"](folder / "plan.csv"), rows[:, : law.measured])


@needs_compiler
@pytest.mark.parametrize("tables", [True, False], ids=["tables", "file"])
def test_c_and_numpy_agree_to_the_last_bit(law_and_plan, recorded, tmp_path, tables):
    law, plan = law_and_plan
    written(tmp_path, law, plan, recorded, tables=tables)
    found, last = replayed_in_c(tmp_path, COMPILERS[0], law.inputs)
    assert np.array_equal(found, replayed_in_numpy(tmp_path, law))
    assert np.abs(found - recorded[1]).max() < 1e-12
    assert last.startswith("40 samples, largest difference ") and last.endswith(" ns a step")


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("precision", ["double", "single"])
def test_every_compiler_takes_it_without_a_warning(
    law_and_plan, recorded, tmp_path, compiler, precision
):
    law, plan = law_and_plan
    written(tmp_path, law, plan, recorded, precision)
    found, _ = replayed_in_c(tmp_path, compiler, law.inputs)
    assert np.abs(found - recorded[1]).max() < (1e-12 if precision == "double" else 1e-4)


@needs_compiler
def test_a_wrong_control_shows(law_and_plan, recorded, tmp_path):
    law, plan = law_and_plan
    y, u = recorded
    u = u.copy()
    u[17, 0] += 0.25
    written(tmp_path, law, plan, (y, u))
    _, last = replayed_in_c(tmp_path, COMPILERS[0], law.inputs)
    assert "largest difference 0.25" in last


STEPPER = """
#include <stdio.h>
#include "controller.h"
int main(void)
{
    drive_controller controller;
    real y[DRIVE_MEASURED], u[DRIVE_INPUTS];
    drive_init(&controller);
    for (long k = 0;; k++) {
        for (int i = 0; i < DRIVE_MEASURED; i++) {
            if (scanf("%lf", &y[i]) != 1) {
                return 0;
            }
        }
        drive_sample sample = drive_plan(k);
        printf("%d", drive_step(&controller, &sample, y, u));
        for (int i = 0; i < DRIVE_INPUTS; i++) {
            printf(" %.17g", u[i]);
        }
        printf("\\n");
    }
}
"""


def stepped_in_c(folder, y):
    """Lost measurements and controls of every sample."""
    (folder / "replay.c").write_text(STEPPER)
    words = [COMPILERS[0], *STRICT, "-o", str(folder / "stepped")]
    subprocess.run([*words, *map(str, folder.glob("*.c"))], check=True)
    text = "\n".join(" ".join(map(repr, row)) for row in y.tolist())
    words = [str(folder / "stepped")]
    told = subprocess.run(words, cwd=folder, input=text, text=True, capture_output=True, check=True)
    rows = np.array([line.split() for line in told.stdout.splitlines()], float)
    return rows[:, 0], rows[:, 1:]


def stepped_in_numpy(folder, y):
    module = {"__file__": str(folder / "controller.py"), "__name__": "controller"}
    exec(compile((folder / "controller.py").read_text(), "controller.py", "exec"), module)
    plan, memory, lost, controls = (
        module["read_plan"](folder / "plan.csv"),
        module["begin"](),
        [],
        [],
    )
    for k, row in enumerate(y):
        memory, u = module["step"](memory, plan[min(k, len(plan) - 1)], row)
        lost.append(memory.fault)
        controls.append(u)
    return lost, controls


@needs_compiler
@pytest.mark.parametrize("tables", [True, False], ids=["tables", "file"])
def test_what_is_no_number_is_not_taken_and_the_last_sample_is_held(
    law_and_plan, recorded, tmp_path, tables
):
    """A lost measurement counts as one that departs from its plan as the last one did."""
    law, plan = law_and_plan
    written(tmp_path, law, plan, recorded, tables=tables)
    held = np.minimum(np.arange(plan.steps + 5), plan.steps - 1)
    longer = replace(
        plan,
        used=plan.used[held],
        f=plan.f[held],
        r=plan.r[held],
        m=None if plan.m is None else plan.m[held],
    )
    y = np.random.default_rng(3).normal(size=longer.r.shape)
    broken = np.zeros(y.shape, bool)
    for k, what in ((0, np.nan), (7, np.nan), (8, np.inf), (9, -np.inf), (20, 1e31), (42, np.nan)):
        y[k, -1], broken[k, -1] = what, True
    y[8], broken[8] = np.nan, True
    away, filled = np.zeros(law.measured), y.copy()
    for k, row in enumerate(broken):
        filled[k] = np.where(row, longer.r[k] + away, y[k])
        away = filled[k] - longer.r[k]
    wanted = replayed(law, longer, filled)
    for lost, controls in (stepped_in_c(tmp_path, y), stepped_in_numpy(tmp_path, y)):
        assert np.array_equal(lost, broken.sum(axis=1))
        assert np.abs(controls - wanted).max() < 1e-11


@needs_compiler
def test_the_first_and_the_last_sample_of_the_plan_are_those_of_its_tables(law_and_plan, tmp_path):
    law, plan = law_and_plan
    program = """
    #include <stdio.h>
    #include "controller.h"
    int main(void)
    {
        const long at[] = {39, 40, 1000000000, -1, 0};
        for (int i = 0; i < 5; i++) {
            printf("%.17g ", drive_plan(at[i]).control[0]);
        }
        return 0;
    }
    """
    for name, code in (("tables", c_plan(plan, "part", "double")), ("file", c_plan_reader(plan))):
        folder = tmp_path / name
        folder.mkdir()
        written(folder, law, plan, (plan.r, plan.f))
        (folder / "plan.c").write_text(code)
        (folder / "replay.c").write_text(program)
        words = [COMPILERS[0], *STRICT, "-o", str(folder / "look"), *map(str, folder.glob("*.c"))]
        subprocess.run(words, check=True)
        told = subprocess.run([str(folder / "look")], cwd=folder, capture_output=True, check=True)
        first, last = plan.f[0, 0], plan.f[-1, 0]
        assert [float(word) for word in told.stdout.split()] == [last, last, last, first, first]


@needs_compiler
@pytest.mark.slow
def test_a_cascade_that_is_far_off_keeps_its_integrators_as_in_python(tmp_path):
    """X stands 5 mm off until the integrator is full; then the tool comes back and passes."""
    dt, limit = 1e-3, np.array([2.0, 3.0])
    gains = CascadeGains(30.0, 20.0, 0.02, 1.0)
    cascade = SpeedByDifference(Cascade(gains, motors(2), dt, limit), Sensors([0, 1]), dt)
    path = contours.circle(1e-3)
    arc = feed_laws.constant_feed(path, 0.05, dt)[:100]
    reference = references.along(path, arc, dt, preview=1, at_rest=False)
    axis = [[1.0, 1e-3], [0.0, 0.9]], [[0.0], [1e-3]], [[1.0, 0.0]]
    plant = Encoders(LinearPlant(*(np.kron(np.eye(2), one) for one in axis), dt=dt))
    run = simulate(plant, cascade, reference)
    affine = linear_form(cascade, reference, run, limit)
    plan = affine.plan_along(np.asarray(run.measurement))
    y = np.asarray(run.measurement) + np.linspace(5e-3, -2e-3, 100)[:, None] * [1.0, -0.5]
    memory, rows, controls = cascade.initial_memory(reference), cascade.prepare(reference), []
    for k, measured in enumerate(y):
        row = jax.tree.map(lambda leaf, k=k: leaf[k], rows)
        memory, u = cascade.step(memory, row, jnp.asarray(measured))
        controls.append(np.asarray(u))
    written(tmp_path, affine.law, plan, (y, np.array(controls)))
    found, last = replayed_in_c(tmp_path, COMPILERS[0], 2)
    assert np.abs(found - controls).max() < 1e-11, last
    loose = replace(affine.law, kept=None), replace(plan, m=None)
    assert np.abs(replayed(*loose, y) - controls).max() > 1.0


def test_nothing_is_allocated_and_nothing_included(law_and_plan):
    law, plan = law_and_plan
    text = c_source(law, plan, "double") + c_plan(plan, "part", "double")
    assert "malloc" not in text
    assert [line for line in text.splitlines() if line.startswith("#")] == [
        '#include "controller.h"'
    ] * 2
