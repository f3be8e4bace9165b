"""Exported C code compiled by the compilers of this computer, and run."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from jcontour.app.files.results.exported_result import Compiled

COMPILERS = ("gcc", "clang")
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2", "-ffp-contract=off")
TOLD = re.compile(r"largest difference (\S+), (\S+) ns a step")
LONGEST = 300  # [s] that compiling or replaying may take


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
