"""The written C code: what compilers, analysers and sanitizers say, and what it needs."""

import ctypes
import re
import shutil
import subprocess

import numpy as np
import pytest

from .conftest import COMPILERS, STRICT, InC, code_of, controllers, needs_compiler, written

ANALYSERS = {
    "clang": "clang --analyze -Xclang -analyzer-werror law.c check.c",
    "cppcheck": "cppcheck --std=c99 --enable=warning,portability -q --error-exitcode=1 .",
}
SANITIZED = "-std=c99 -g -fsanitize=address,undefined -fno-sanitize-recover=all".split()


@needs_compiler
@pytest.mark.parametrize("name", controllers())
def test_every_compiler_takes_it_without_a_warning(name, tmp_path):
    for precision in ("double", "single"):
        written(tmp_path, code_of(name, precision))
        for compiler in COMPILERS:
            words = [compiler, *STRICT, "law.c", "check.c", "-o", "check"]
            done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("tool", ANALYSERS)
def test_analysers_find_nothing(tool, tmp_path):
    if not shutil.which(tool):
        pytest.skip(f"{tool} is not installed")
    written(tmp_path, code_of("contouring"))
    done = subprocess.run(ANALYSERS[tool].split(), cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "warning" not in done.stderr, done.stderr


@needs_compiler
@pytest.mark.parametrize("name", ["contouring", "cascade"])
def test_sanitizers_find_nothing(name, tmp_path):
    code = code_of(name)
    written(tmp_path, code)
    rows = np.zeros((60, 4 + code.law.measured + code.law.inputs))
    rows[:, 0] = 1e-5 * np.arange(60)
    rows[:, 4 : 4 + code.law.measured] = rows[:, :2] @ code.law.seen.T
    rows[20:30, 4] = np.nan
    np.savetxt(tmp_path / "check.csv", rows, delimiter=",", header="rows")
    words = [COMPILERS[0], *SANITIZED, "law.c", "check.c", "-o", "check"]
    subprocess.run(words, cwd=tmp_path, check=True)
    done = subprocess.run(["./check", "check.csv"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.search(rf"{60 - code.law.points + 1} samples, largest difference", done.stdout)
    assert f"trip 2 at sample {25}" in done.stdout  # the measurement that is lost


@needs_compiler
def test_it_is_small(tmp_path):
    law = InC(code_of("contouring"), tmp_path)
    assert ctypes.sizeof(law.memory) < 4_000
    if shutil.which("size"):
        said = subprocess.run(["size", str(tmp_path / "law.so")], capture_output=True, text=True)
        assert int(said.stdout.splitlines()[1].split()[3]) < 40_000


def test_nothing_is_allocated_and_nothing_included():
    for name in controllers():
        text = code_of(name).text("law.c.j2")
        assert "alloc" not in text
        lines = [line for line in text.splitlines() if line.startswith("#")]
        assert lines == ['#include "law.h"']
