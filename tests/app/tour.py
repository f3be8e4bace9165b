"""One tour through the commands: each runs once, in this process, on a small machine and part.

Tests of words, tables, figures and files read what it left. They do not run commands again.
"""

import io
import json
import re
from collections.abc import Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from jcontour.app.cli import main
from jcontour.app.files.results.stored import read_result

Result = TypeVar("Result")

MACHINE = "--plant machine.json"
LONG = ("front", "identify")  # with the long tests
LIMITS = {"travel": 400, "speed": 250, "acceleration": 2000, "dt": 0.002}
STOPS: Mapping[str, str] = {  # name -> command; a name in braces is the run folder of a stop
    "list": "list",
    "machine": "machine machine.json",
    "new-machine": "machine --gain 1 --time-constant-ms 20 15 --delay-ms 1.5 --max-control 250 "
    "--name mill --out mill.json",
    "simulate": f"simulate part.ngc {MACHINE} --preview 4",
    "tune": f"tune part.ngc {MACHINE} --alpha 1e3 --beta 1e4 --preview 4 --scatter 0 --starts 1 "
    "--steps 8",
    "compare": "report {tune} {tune} --no-page",
    "check": "check {tune} --max-increment 5",
    "report": "report {tune} {simulate} --out pages",
    "front-feed": "front {simulate} --against feed --overrides 100 50",
    "precompensate": f"precompensate part.ngc {MACHINE}",
    "learn": f"learn part.ngc {MACHINE} --preview 4 --laps 6",
    "check-bound": "check {simulate} --bound --force 0.5",
    "check-bound-tuned": "check {tune} --bound",
    "export": "export {simulate} --c --st --python",
    "export-tuned": "export {tune} --single",
    "front": f"front part.ngc {MACHINE} --points 2 --preview 4 --max-sensitivity None",
    "rank": f"rank part.ngc {MACHINE} --preview 4 --evaluations 3 "
    "--controllers contouring-lq-kalman contouring-lq",
    "sweep": f"sweep part.ngc {MACHINE} --vary alpha=2,2e6 beta=0.5,5 --previews 4 --rho 2e-9 "
    "--controller contouring-lq-kalman --weights control_noise=5 --devices 1",
    "traverse": "simulate square --controller mpcc --plant xy-table --preview 7",
    "excite": "identify --excite limits.json",
    "identify": "identify --demo --most-order 1 --most-delay 4",
}
BRIEF = ("list", "machine", "new-machine", "report", "check-bound-tuned")  # no tables, or not here
NO_RUN = ("list", "machine", "new-machine", "compare", "report")  # they have a file, or print alone


@dataclass(frozen=True)
class Visit:
    """What a command left.

    Attributes:
        code: exit code.
        out, err: what it printed.
        folder: of the run; empty for a command without one.
    """

    code: int
    out: str
    err: str
    folder: Path

    def result(self, kind: type[Result]) -> Result:
        """The stored result of the run."""
        return read_result(self.folder, kind)

    def stored(self, name: str = "result.json") -> Any:
        """A JSON file of the run."""
        return json.loads((self.folder / name).read_text())

    def files(self) -> set[str]:
        """Names of the files and folders in the run folder."""
        return {path.name for path in self.folder.iterdir()}


class Tour:
    """Commands that run when they are first asked for, in one folder."""

    def __init__(self, folder: Path, machine: Mapping[str, Any], part: str):
        self.folder = folder
        self._visits: dict[str, Visit] = {}
        (folder / "machine.json").write_text(json.dumps(machine))
        (folder / "part.ngc").write_text(part)
        (folder / "limits.json").write_text(json.dumps(LIMITS))

    def __call__(self, name: str) -> Visit:
        """What the command of a stop left; those whose runs it reads go first."""
        if name not in self._visits:
            for needed in re.findall(r"{(.+?)}", STOPS[name]):
                self(needed)
            self._visits[name] = self._run(name)
        return self._visits[name]

    def _run(self, name: str) -> Visit:
        words = re.sub(r"{(.+?)}", r"\1", STOPS[name]).split()
        out, err = io.StringIO(), io.StringIO()
        where = [] if name in NO_RUN else ["--out", name]
        where += [] if name in BRIEF else ["--details"]
        with chdir(self.folder), redirect_stdout(out), redirect_stderr(err):
            code = main([*words, *where])
        return Visit(code, out.getvalue(), err.getvalue(), self.folder / name)


def masked(text: str) -> str:
    """Printed words without their numbers and without the layout of tables.

    A number becomes #, columns are one space apart, a rule is one character, and the compilers are
    those of any computer.
    """
    text = re.sub(r"\x1b\[[\d;]*m", "", text)
    text = re.sub(r"(?<![\w.])[-+−]?\d[\d,_]*(\.\d+)?(e[-+]?\d+)?", "#", text)
    text = re.sub(r"([─━═╌╶╴]+ *)+", "─", text)
    text = re.sub(r"; (gcc, clang|gcc|clang)$", "; compilers", text, flags=re.MULTILINE)
    lines = [re.sub(r"\s+", " ", line).strip() for line in text.splitlines()]
    # neither progress nor a line for each compiler
    lines = [line for line in lines if "#:#:#" not in line and not line.startswith("Checked: ")]
    return re.sub(r"\n{2,}", "\n\n", "\n".join(lines)).strip() + "\n"
