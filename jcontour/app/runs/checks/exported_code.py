"""Trials of exported code: its Python, the compilers that are here, and a program in LinuxCNC."""

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock
from jaxtyping import Float

from jcontour.app.files.results.loop_results import Compiled
from jcontour.export.linuxcnc import DRIVE
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
    match = SAID.search(said)
    if match is None:
        raise RuntimeError(f"export: the program of {compiler} said {said!r}")
    difference, *times = (float(word) for word in match.groups()[:4])
    return Compiled(
        compiler=f"{compiler} {' '.join(FLAGS)}",
        difference=difference,
        nanoseconds=times[0],
        slow=times[1],
        slowest=times[2],
        code_bytes=code,
        memory_bytes=int(match[5]),
    )


def _said(words: list[str], folder: Path) -> str:
    done = subprocess.run(words, cwd=folder, text=True, capture_output=True, timeout=LONGEST)
    if done.returncode != 0 or done.stderr:
        raise RuntimeError(f"export: {words[0]} failed: {done.stderr.strip()}")
    return done.stdout


NEEDED = ("linuxcnc", "halcompile", "halsampler")
COMPONENTS = ("jcontour_law", "jcontour_machine")
USER = "nobody"  # LinuxCNC refuses to run as root
STILL = 1e-9  # [m] of a sample: the axes are not commanded to move
STATUS_TRIPPED = 5


@dataclass(frozen=True)
class RealRun:
    """Samples of the servo thread, from the first motion to the end of the last."""

    command: Float[np.ndarray, "T m"]  # what the axes follow [m]
    tool: Float[np.ndarray, "T m"]  # where the tool of the machine component is [m]
    samples: int  # of the planner's motion: its cycle time


def missing() -> str:
    """Why no program can be run here; empty where one can."""
    absent = [name for name in NEEDED if not shutil.which(name)]
    if absent:
        return (
            f"LinuxCNC is not installed ({', '.join(absent)} not found); "
            "on Debian: apt install linuxcnc-uspace linuxcnc-uspace-dev"
        )
    return ""


def run_in_linuxcnc(components: Mapping[str, str], program: str, longest: float) -> RealRun:
    """Run a program of G-code; components and configuration are those of `linuxcnc_files`.

    Raises:
        ValueError: it does not build, does not end, trips, or samples are lost.
    """
    alone = Path(tempfile.gettempdir()) / "jcontour-linuxcnc.lock"  # two would share its memory
    with FileLock(alone), tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        for name, text in components.items():
            (folder / name).write_text(text)
        (folder / "program.ngc").write_text(program)
        (folder / DRIVE).chmod(0o755)
        for name in COMPONENTS:  # built, and put where LinuxCNC looks for it
            words = ["halcompile", "--install", f"{name}.comp"]
            if os.geteuid() != 0:
                words = ["sudo", "-n", *words]
            done = subprocess.run(words, cwd=folder, text=True, capture_output=True)
            if done.returncode != 0:
                fault = (done.stderr or done.stdout).strip()[-500:]
                raise ValueError(f"linuxcnc: {' '.join(words)} failed: {fault}")
        _run(folder, longest)
        return _read(folder)


def _run(folder: Path, longest: float) -> None:
    environment = {**os.environ, "HOME": str(folder), "DISPLAY": "", "LONGEST": str(longest)}
    user = None
    if os.geteuid() == 0:
        user = USER
        for path in (folder, *folder.iterdir()):
            shutil.chown(path, USER)
    done = subprocess.run(
        ["linuxcnc", "machine.ini"],
        cwd=folder,
        env=environment,
        user=user,
        text=True,
        capture_output=True,
        timeout=longest + 60.0,
    )
    said = folder / "errors.txt"
    if not said.exists():
        raise ValueError(f"linuxcnc: it did not start: {(done.stdout + done.stderr)[-800:]}")
    if errors := said.read_text().strip():
        raise ValueError(f"linuxcnc: {errors}")


def _read(folder: Path) -> RealRun:
    lines = (folder / "samples.txt").read_text().splitlines()
    if any("overrun" in line for line in lines):
        raise ValueError("linuxcnc: samples of the servo thread were lost")
    rows = np.array([line.split() for line in lines], float)
    number, values, status = rows[:, 0], 1e-3 * rows[:, 1:-1], rows[:, -1]
    if np.any(np.diff(number) != 1.0):
        raise ValueError("linuxcnc: samples of the servo thread were lost")
    if np.any(status == STATUS_TRIPPED):
        raise ValueError("linuxcnc: the law tripped")
    axes = values.shape[1] // 2
    command, tool = values[:, :axes], values[:, axes:]
    moves = np.flatnonzero(np.abs(np.diff(command, axis=0)).max(axis=1) > STILL)
    if moves.size == 0:
        raise ValueError("linuxcnc: the program moves nothing")
    first, last = moves[0], moves[-1] + 1
    after = min(len(command), last + 100)  # what is left of the motion settles
    return RealRun(command[first:after], tool[first:after], int(last - first))


def distance_to_path(
    path: Float[np.ndarray, "S m"], place: Float[np.ndarray, "T m"], reach: int = 40
) -> Float[np.ndarray, " T"]:
    """Distance of place k from the pieces of a path within `reach` samples of its sample k [m]."""
    a, along = path[:-1], np.diff(path, axis=0)
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    distance = np.full(len(place), np.inf)
    for shift in range(-reach, reach + 1):
        k = np.clip(np.arange(len(place)) + shift, 0, len(a) - 1)
        part = np.clip(((place - a[k]) * along[k]).sum(axis=1) / square[k], 0.0, 1.0)
        distance = np.minimum(
            distance, np.linalg.norm(a[k] + part[:, None] * along[k] - place, axis=1)
        )
    return distance
