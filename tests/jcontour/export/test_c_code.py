"""The C code is compiled with every warning on, run, and compared bit by bit."""

import shutil
import subprocess

import numpy as np
import pytest

from jcontour.export.c_code import c_header, c_plan, c_source
from jcontour.export.c_replay import Units, c_plan_reader, c_replay, plan_file, replay_file
from jcontour.export.numpy_code import numpy_source

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


def test_nothing_is_allocated_and_nothing_included(law_and_plan):
    law, plan = law_and_plan
    text = c_source(law, plan, "double") + c_plan(plan, "part", "double")
    assert "malloc" not in text
    assert [line for line in text.splitlines() if line.startswith("#")] == [
        '#include "controller.h"'
    ] * 2
