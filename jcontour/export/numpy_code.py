"""A drive's law as one file of plain NumPy: the same sums in the same order as the C code."""

from collections.abc import Sequence
from string import Template

import numpy as np

from jcontour.export.c_code import LARGEST
from jcontour.export.code_text import literal, plain
from jcontour.export.drive_law import DriveLaw, DrivePlan


def numpy_source(law: DriveLaw, plan: DrivePlan, notes: Sequence[str]) -> str:
    """Text of `controller.py`; it reads `plan.csv`, and replays `replay.csv` when it is run."""
    matrices = []
    if law.correction is not None:
        matrices += [("L", law.correction.L), ("C", law.correction.C)]
    matrices += [(name, getattr(law, name)) for name in ("A", "B", "E")]
    limited = np.isfinite(law.limit).any()
    if limited:
        matrices.append(("LIMIT", law.limit))
    if law.clamped.size:
        matrices.append(("KEPT", law.clamps))
    return _SOURCE.substitute(
        notes="\n".join(plain(line).replace('"""', "'''").replace("\\", "/") for line in notes),
        period=literal(law.dt),
        measured=law.measured,
        tables="\n".join(_constant(name, one) for name, one in matrices if one is not None),
        memory=law.states,
        sizes=_sizes(law, plan),
        body="\n".join(f"    {line}".rstrip() for line in _body(law, plan, bool(limited))),
    )


def _sizes(law: DriveLaw, plan: DrivePlan) -> str:
    """Shapes of the parts of a line of the plan, in its order."""
    n, p, q = law.states, law.inputs, law.measured
    there: dict[str, tuple[int, ...]] = {"f": (p,), "r": (q,)}
    if plan.F is not None:
        there["F"] = (p, n)
    if plan.D is not None:
        there["D"] = (p, q)
    if plan.m is not None:
        there["m"] = (plan.m.shape[1],)
    return repr(there)


def _body(law: DriveLaw, plan: DrivePlan, limited: bool) -> list[str]:
    lines = [
        "# departure from the planned run: z = y - r; the last one where y is no number",
        f"there = np.abs(y) <= {literal(LARGEST)}",
        'z = np.where(there, y - plan["r"], memory.z)',
    ]
    if law.correction is not None:
        lines += [
            "# correction: e += L (z - C e)",
            "e = added(e, L, added(z, -C, e))",
        ]
    lines += ["# control: u = f - F e - D z", 'u = plan["f"]']
    lines += ['u = added(u, -plan["F"], e)'] if plan.F is not None else []
    lines += ['u = added(u, -plan["D"], z)'] if plan.D is not None else []
    lines += ["u = np.clip(u, -LIMIT, LIMIT)"] if limited else []
    lines += ["# memory of the next sample"]
    if law.B is not None:
        planned = 'np.clip(plan["f"], -LIMIT, LIMIT)' if limited else 'plan["f"]'
        lines += [f"change = u - {planned}"]
    lines += ["after = np.zeros(MEMORY)"]
    for name, signal in (("A", "e"), ("B", "change"), ("E", "z")):
        if getattr(law, name) is not None:
            lines.append(f"after = added(after, {name}, {signal})")
    if law.clamped.size:
        at = f"[{', '.join(str(entry) for entry in law.clamped)}]"
        lines += [
            "# the controller keeps this part of its memory within limits",
            f'kept = np.clip(after[{at}], -KEPT - plan["m"], KEPT - plan["m"])',
            f'after[{at}] = kept + (plan["m"] - np.clip(plan["m"], -KEPT, KEPT))',
        ]
    return [*lines, "return Memory(after, z, int(np.sum(~there))), u"]


def _constant(name: str, matrix: np.ndarray) -> str:
    if matrix.ndim == 1:
        return f"{name} = np.array([{_words(matrix)}])"
    rows = "\n".join(f"    [{_words(row)}]," for row in matrix)
    return f"{name} = np.array([\n{rows}\n])"


def _words(row: np.ndarray) -> str:
    return ", ".join(literal(value) if np.isfinite(value) else "np.inf" for value in row)


_SOURCE = Template('''\
"""
$notes

Begin with memory = begin(). Every sample: memory, u = step(memory, plan[k], y); after the last line
of the plan hold that line. A measurement that is no number (NaN, infinite) is not taken: the axis
counts as far from its plan as it was one sample before, and memory.fault says how many are lost.
`python controller.py` replays replay.csv.
"""

import time
from collections import namedtuple
from pathlib import Path

import numpy as np

PERIOD = $period  # s between two samples
MEASURED = $measured  # numbers in y
MEMORY = $memory  # numbers that are remembered
$tables
PLAN = $sizes  # a line of plan.csv, after k and t

# what is remembered, the last departure from the plan, and how many measurements are no numbers
Memory = namedtuple("Memory", "e z fault")


def added(total, matrix, vector):
    """total + matrix vector, from the first column to the last, as in C."""
    for column, number in zip(matrix.T, vector):
        total = total + column * number
    return total


def begin():
    """Memory before the first sample."""
    return Memory(np.zeros(MEMORY), np.zeros(MEASURED), 0)


def step(memory, plan, y):
    """Memory of the next sample, and the controls of this one."""
    e = memory.e
$body


def read_plan(path):
    """The plan: a dict of arrays for every sample."""
    rows = []
    for line in np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2):
        row, first = {}, 2
        for name, shape in PLAN.items():
            last = first + int(np.prod(shape))
            row[name], first = line[first:last].reshape(shape), last
        rows.append(row)
    return rows


def replay(plan, measurements):
    """Controls of a whole run."""
    memory, controls = begin(), []
    for row, y in zip(plan, measurements):
        memory, u = step(memory, row, y)
        controls.append(u)
    return np.array(controls)


if __name__ == "__main__":
    here = Path(__file__).parent
    rows = np.loadtxt(here / "replay.csv", delimiter=",", skiprows=1, ndmin=2)
    plan = read_plan(here / "plan.csv")
    before = time.perf_counter()
    controls = replay(plan, rows[:, :MEASURED])
    step_time = (time.perf_counter() - before) / len(rows)
    apart = np.abs(controls - rows[:, MEASURED:]).max()
    print(f"{len(rows)} samples, largest difference {apart:.3g}, {1e9 * step_time:.1f} ns a step")
''')
