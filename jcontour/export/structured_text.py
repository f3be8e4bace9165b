"""A drive's law as a function block in IEC 61131-3 structured text.

The plan stays outside of the block: a PLC hands it one line of `plan.csv` every sample, from a
recipe or from its host. Names differ by more than their case, which compilers do not see, and
matrices have no single letters, which are addresses or qualifiers in some.
"""

from collections.abc import Sequence
from string import Template

import numpy as np

from jcontour.export.c_code import LARGEST
from jcontour.export.code_text import Precision, literal, plain
from jcontour.export.drive_law import DriveLaw, DrivePlan

TYPES: dict[Precision, str] = {"double": "LREAL", "single": "REAL"}


def structured_text(
    law: DriveLaw, plan: DrivePlan, notes: Sequence[str], precision: Precision
) -> str:
    """Text of `controller.st`: the function block `DriveController`."""
    n, p, q, kind = law.states, law.inputs, law.measured, TYPES[precision]
    inputs = [
        _variable("planned", p, kind, words="f of the plan"),
        _variable("expected", q, kind, words="r of the plan"),
        _variable("feedback", p * n, kind, words="F of the plan, row by row")
        if _there(plan.F)
        else "",
        _variable("direct", p * q, kind, words="D of the plan, row by row")
        if _there(plan.D)
        else "",
        _variable("planned_memory", law.clamped.size, kind, words="m of the plan")
        if law.clamped.size
        else "",
    ]
    constants = []
    if law.correction is not None:
        constants += [("matrix_L", law.correction.L), ("matrix_C", law.correction.C)]
    constants += [("matrix_A", law.A), ("matrix_B", law.B), ("matrix_E", law.E)]
    if np.isfinite(law.limit).any():
        constants.append(("most", np.where(np.isfinite(law.limit), law.limit, 3.4e38)))
    if law.clamped.size:
        constants.append(("kept", law.clamps))
    return _BLOCK.substitute(
        notes="\n".join(plain(line) for line in notes),
        kind=kind,
        period=literal(law.dt),
        q=q,
        p=p,
        n=max(n, 1),
        inputs="\n".join(line for line in inputs if line),
        constants=_constants([(name, one) for name, one in constants if one is not None], kind),
        body="\n".join([*_start(law), *_correction(law), *_control(law, plan), *_memory(law)]),
    )


def _constants(given: Sequence[tuple[str, np.ndarray]], kind: str) -> str:
    """Their part of the block; a part without any variable is no structured text."""
    if not given:
        return ""
    lines = (_variable(name, one.size, kind, one) for name, one in given)
    return "\n".join(["VAR CONSTANT", *lines, "END_VAR", ""])


def _there(matrix: np.ndarray | None) -> bool:
    return matrix is not None


def _variable(
    name: str, size: int, kind: str, values: np.ndarray | None = None, words: str = ""
) -> str:
    told = f" (* {words} *)" if words else ""
    if values is None:
        return f"    {name} : ARRAY[1..{size}] OF {kind};{told}"
    rows = np.reshape(values, (-1, values.shape[-1]))
    numbers = ",\n".join("        " + ", ".join(literal(x) for x in row) for row in rows)
    return f"    {name} : ARRAY[1..{size}] OF {kind} := [\n{numbers}];{told}"


def _start(law: DriveLaw) -> list[str]:
    q, n = law.measured, law.states
    lines = []
    if n:
        lines = _each(n, "    ", "memory[i] := 0.0;")
    lines += _each(q, "    ", "departure[i] := 0.0;")
    number = literal(LARGEST)
    return [
        *("IF restart THEN", *lines, "END_IF;"),
        "(* departure from the planned run: z = y - r; the last one where y is no number *)",
        "fault := FALSE;",
        f"FOR i := 1 TO {q} DO",
        f"    IF measured[i] >= -{number} AND measured[i] <= {number} THEN",
        "        departure[i] := measured[i] - expected[i];",
        "    ELSE",
        "        fault := TRUE;",
        "    END_IF;",
        "END_FOR;",
    ]


def _each(count: int, indent: str, statement: str) -> list[str]:
    """A statement for every i."""
    lines = (f"FOR i := 1 TO {count} DO", f"    {statement}", "END_FOR;")
    return [f"{indent}{line}" for line in lines]


def _correction(law: DriveLaw) -> list[str]:
    if law.correction is None:
        return []
    n, q = law.states, law.measured
    return [
        "(* correction of the memory: e + L (z - C e) *)",
        *_sum(q, "miss", "departure[i]", [("-", "matrix_C", n, "memory")]),
        *_sum(n, "memory", "memory[i]", [("+", "matrix_L", q, "miss")]),
    ]


def _control(law: DriveLaw, plan: DrivePlan) -> list[str]:
    n, p, q = law.states, law.inputs, law.measured
    terms = [("-", "feedback", n, "memory")] if _there(plan.F) else []
    terms += [("-", "direct", q, "departure")] if _there(plan.D) else []
    lines = ["(* control: u = f - F e - D z *)", *_sum(p, "control", "planned[i]", terms)]
    if np.isfinite(law.limit).any():
        lines += _each(p, "", f"control[i] := {_kept(law, 'control[i]')};")
    return lines


def _kept(law: DriveLaw, signal: str) -> str:
    """A control within its limit."""
    return f"LIMIT(-most[i], {signal}, most[i])" if np.isfinite(law.limit).any() else signal


def _memory(law: DriveLaw) -> list[str]:
    n = law.states
    if n == 0:
        return []
    lines = ["(* memory of the next sample *)"]
    if law.B is not None:
        change = f"change[i] := control[i] - {_kept(law, 'planned[i]')};"
        lines += _each(law.inputs, "", change)
    terms = [
        ("+", name, size, signal)
        for name, matrix, size, signal in (
            ("matrix_A", law.A, n, "memory"),
            ("matrix_B", law.B, law.inputs, "change"),
            ("matrix_E", law.E, law.measured, "departure"),
        )
        if matrix is not None
    ]
    lines += _sum(n, "after", "0.0", terms)
    if law.clamped.size:
        lines.append("(* the controller keeps this part of its memory within limits *)")
    for k, entry in enumerate(law.clamped + 1, start=1):
        here = f"planned_memory[{k}]"
        low, high = (f"{sign}kept[{k}] - {here}" for sign in ("-", ""))
        lines.append(f"after[{entry}] := LIMIT({low}, after[{entry}], {high});")
        beyond = f"{here} - LIMIT(-kept[{k}], {here}, kept[{k}])"
        lines.append(f"after[{entry}] := after[{entry}] + ({beyond});")
    return [*lines, *_each(n, "", "memory[i] := after[i];")]


def _sum(rows: int, name: str, first: str, terms: Sequence[tuple[str, str, int, str]]) -> list[str]:
    """name[i] := first + the products, from the first column to the last."""
    lines = [f"FOR i := 1 TO {rows} DO", f"    total := {first};"]
    for sign, matrix, columns, signal in terms:
        entry = f"{matrix}[(i - 1) * {columns} + j]"
        lines += [
            f"    FOR j := 1 TO {columns} DO",
            f"        total := total {sign} {entry} * {signal}[j];",
            "    END_FOR;",
        ]
    return [*lines, f"    {name}[i] := total;", "END_FOR;"]


_BLOCK = Template("""\
(*
$notes

Call the block once a sample, every $period s, with `restart` in the first one. After the last line
of the plan hold that line.
A measurement that is no number (NaN, infinite) is not taken: the axis counts as far from its plan
as it was one sample before, and `fault` is true in that sample. Stop the axes where that goes on.
*)
FUNCTION_BLOCK DriveController
VAR_INPUT
    restart : BOOL; (* the axes stand where the path begins, see Start above *)
    measured : ARRAY[1..$q] OF $kind; (* y *)
$inputs
END_VAR
VAR_OUTPUT
    control : ARRAY[1..$p] OF $kind; (* u *)
    fault : BOOL; (* a measurement is no number *)
END_VAR
${constants}VAR
    memory : ARRAY[1..$n] OF $kind; (* e: less that of the planned run *)
    departure : ARRAY[1..$q] OF $kind; (* z: measured, less that of the planned run *)
    after : ARRAY[1..$n] OF $kind;
    change : ARRAY[1..$p] OF $kind;
    miss : ARRAY[1..$q] OF $kind;
    total : $kind;
    i : INT;
    j : INT;
END_VAR

$body
END_FUNCTION_BLOCK
""")
