"""Trials of exported code: its Python on the recorded run, and the compilers that are here."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jcontour.app.files.results.loop_results import Compiled
from jcontour.export.rendering import TRIPS
from jcontour.motion.references import Reference

COMPILERS = ("gcc", "clang")
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2", "-ffp-contract=off")
SAID = re.compile(
    r"largest difference (\S+), (\S+) ns a sample, (\S+) ns in the slowest of a thousand, "
    r"(\S+) ns at most, (\d+) bytes"
)
LONGEST = 300  # [s] that compiling or replaying may take


def replayed(
    source: str,
    reference: Reference,
    measurement: Float[np.ndarray, "T q"],
    control: Float[np.ndarray, "T p"],
) -> tuple[Float[np.ndarray, "T p"], str]:
    """Controls of exported Python on a recorded run, and the trip that ended it; "" without one."""
    module: dict[str, Any] = {"__name__": "law", "__file__": "law.py"}
    exec(compile(source, "law.py", "exec"), module)
    law, ahead = module["Law"](), module["LAW_POINTS"]
    position, tangent = np.asarray(reference.position), np.asarray(reference.tangent)
    law.control = control[0].tolist()  # in force before: a run may begin in motion
    law.start(position[0], np.asarray(reference.start_increment))
    controls = []
    for k, y in enumerate(measurement):
        seen = slice(k, k + ahead)
        controls.append(law.step(position[seen], y, tangent[seen], k))
    return np.array(controls), "" if law.trip == 0 else list(TRIPS.values())[law.trip]


def compiled_checks(folder: Path) -> list[Compiled]:
    """Difference, time and size, by every compiler that is installed.

    Raises:
        RuntimeError: a compiler warns, or the program fails: a fault of the code that was written.
    """
    return [_checked(folder, name) for name in COMPILERS if shutil.which(name)]


def _checked(folder: Path, compiler: str) -> Compiled:
    with tempfile.TemporaryDirectory() as work:
        program, law = str(Path(work) / "check"), str(Path(work) / "law.o")
        _said([compiler, *FLAGS, "-c", "law.c", "-o", law], folder)
        _said([compiler, *FLAGS, law, "check.c", "-I.", "-o", program], folder)
        said = _said([program, "check.csv"], folder)
        code = 0
        if shutil.which("size"):
            text, data, bss = _said(["size", law], folder).splitlines()[1].split()[:3]
            code = int(text) + int(data) + int(bss)
    found = SAID.search(said)
    if found is None:
        raise RuntimeError(f"export: the program of {compiler} said {said!r}")
    difference, *times = (float(word) for word in found.groups()[:4])
    return Compiled(
        compiler=f"{compiler} {' '.join(FLAGS)}",
        difference=difference,
        nanoseconds=times[0],
        slow=times[1],
        slowest=times[2],
        code_bytes=code,
        memory_bytes=int(found[5]),
    )


def _said(words: list[str], folder: Path) -> str:
    done = subprocess.run(words, cwd=folder, text=True, capture_output=True, timeout=LONGEST)
    if done.returncode != 0 or done.stderr:
        raise RuntimeError(f"export: {words[0]} failed: {done.stderr.strip()}")
    return done.stdout
