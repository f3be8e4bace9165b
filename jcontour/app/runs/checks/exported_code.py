"""Trials of exported code: the recorded run, the same run off its plan, compilers that are here."""

import re
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour.app.files.results.loop_results import Compiled
from jcontour.export.affine_law import AffineLaw
from jcontour.export.code_text import Precision
from jcontour.export.drive_law import DriveLaw, DrivePlan, replayed

COMPILERS = ("gcc", "clang")
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2", "-ffp-contract=off")
TOLD = re.compile(r"largest difference (\S+), (\S+) ns a step")
LONGEST = 300  # [s] that compiling or replaying may take


CHANGE = 0.1  # of the largest control: far above rounding, and mostly below the limit
NUMBERS: dict[Precision, type[np.floating]] = {"double": np.float64, "single": np.float32}


def off_the_plan(
    law: DriveLaw, plan: DrivePlan, u: Float[np.ndarray, "T p"]
) -> Float[np.ndarray, "T q"]:
    """Measurements of the planned run with a slow wave on each of them.

    On its plan a law has nothing to do: the feedback is seen only off it. The wave of measurement j
    has j + 3/2 periods along the run. Its size is that which changes the controls by a tenth of the
    largest one.
    """
    steps, measured = plan.r.shape
    periods = np.arange(measured) + 1.5
    phase = 2.0 * np.pi * np.arange(steps)[:, None] * periods / steps
    ranges = np.ptp(plan.r, axis=0)
    ranges[ranges == 0.0] = ranges.max()  # of an axis that stands still
    wave = ranges * np.sin(phase)
    free = replace(law, limit=np.full(law.inputs, np.inf))
    still = replace(plan, f=np.zeros_like(plan.f), r=np.zeros_like(plan.r))
    largest = np.abs(replayed(free, still, wave)).max()
    size = CHANGE * np.abs(u).max() / largest if largest > 0.0 else 0.0  # no feedback at all
    return plan.r + size * wave


def rounding(
    affine: AffineLaw, plan: DrivePlan, y: Float[np.ndarray, "T q"], precision: Precision
) -> float:
    """Largest difference that the written numbers make to the controls of recorded measurements."""
    _, exact = affine.run(y)
    return float(np.abs(replayed(affine.law, plan, y, NUMBERS[precision]) - exact).max())


def compiled_checks(folder: Path) -> list[Compiled]:
    """Difference and time of a step, by every compiler that is installed.

    Raises:
        RuntimeError: a compiler warns, or the program fails: a fault of the code that was written.
    """
    return [_checked(folder, name) for name in COMPILERS if shutil.which(name)]


def _checked(folder: Path, compiler: str) -> Compiled:
    with tempfile.TemporaryDirectory() as work:
        program = str(Path(work) / "replay")
        sources = [name.name for name in sorted(folder.glob("*.c"))]
        _told([compiler, *FLAGS, *sources, "-o", program], folder)
        told = _told([program, "replay.csv"], folder)
    found = TOLD.search(told)
    if found is None:
        raise RuntimeError(f"export: the program of {compiler} said {told!r}")
    flags = " ".join(FLAGS)
    return Compiled(
        compiler=f"{compiler} {flags}", difference=float(found[1]), nanoseconds=float(found[2])
    )


def _told(words: list[str], folder: Path) -> str:
    done = subprocess.run(words, cwd=folder, text=True, capture_output=True, timeout=LONGEST)
    if done.returncode != 0 or done.stderr:
        raise RuntimeError(f"export: {words[0]} failed: {done.stderr.strip()}")
    return done.stdout
