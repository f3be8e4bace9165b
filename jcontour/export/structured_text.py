"""A drive's law as a function block in IEC 61131-3 structured text.

The plan stays outside of the block: a PLC hands it one line of `plan.csv` every sample, from a
recipe or from its host.
"""

from collections.abc import Sequence
from string import Template

import numpy as np

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
        _variable("feedback", p * n, kind, words="F of the plan, row by row")
        if _there(plan.F)
        else "",
        _variable("direct", p * q, kind, words="D of the plan, row by row")
        if _there(plan.D)
        else "",
        _variable("ahead", n, kind, words="w of the plan") if _there(plan.w) else "",
    ]
    constants = [("START", law.start if n else None)]
    if law.correction is not None:
        constants += [("L", law.correction.L), ("C", law.correction.C)]
    constants += [("A", law.A), ("B", law.B), ("E", law.E)]
    if np.isfinite(law.limit).any():
        constants.append(("MOST", np.where(np.isfinite(law.limit), law.limit, 3.4e38)))
    return _BLOCK.substitute(
        notes="\n".join(plain(line) for line in notes),
        kind=kind,
        period=literal(law.dt),
        q=q,
        p=p,
        n=max(n, 1),
        inputs="\n".join(line for line in inputs if line),
        constants=_constants([(name, one) for name, one in constants if one is not None], kind),
        body="\n".join(
            [*_start(law), *_correction(law), *_control(law, plan), *_memory(law, plan)]
        ),
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
    if law.states == 0:
        return []
    return [
        "IF restart THEN",
        f"    FOR i := 1 TO {law.states} DO",
        "        x[i] := START[i];",
    ] + [
        "    END_FOR;",
        "END_IF;",
    ]


def _correction(law: DriveLaw) -> list[str]:
    if law.correction is None:
        return []
    n, q = law.states, law.measured
    return [
        "(* correction: x := x + L (y - C x) *)",
        *_sum(q, "miss", "measured[i]", [("-", "C", n, "x")]),
        *_sum(n, "x", "x[i]", [("+", "L", q, "miss")]),
    ]


def _control(law: DriveLaw, plan: DrivePlan) -> list[str]:
    n, p, q = law.states, law.inputs, law.measured
    terms = [("-", "feedback", n, "x")] if _there(plan.F) else []
    terms += [("-", "direct", q, "measured")] if _there(plan.D) else []
    lines = ["(* control: u := f - F x - D y *)", *_sum(p, "control", "planned[i]", terms)]
    if np.isfinite(law.limit).any():
        lines += [
            f"FOR i := 1 TO {p} DO",
            "    control[i] := LIMIT(-MOST[i], control[i], MOST[i]);",
            "END_FOR;",
        ]
    return lines


def _memory(law: DriveLaw, plan: DrivePlan) -> list[str]:
    n = law.states
    if n == 0:
        return []
    first = "ahead[i]" if _there(plan.w) else "0.0"
    terms = [
        ("+", name, size, signal)
        for name, matrix, size, signal in (
            ("A", law.A, n, "x"),
            ("B", law.B, law.inputs, "control"),
            ("E", law.E, law.measured, "measured"),
        )
        if matrix is not None
    ]
    lines = ["(* memory of the next sample *)", *_sum(n, "after", first, terms)]
    return [*lines, f"FOR i := 1 TO {n} DO", "    x[i] := after[i];", "END_FOR;"]


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

Call the block once a sample, every $period s, with `restart` in the first one.
*)
FUNCTION_BLOCK DriveController
VAR_INPUT
    restart : BOOL; (* begin where the path begins *)
    measured : ARRAY[1..$q] OF $kind; (* y *)
$inputs
END_VAR
VAR_OUTPUT
    control : ARRAY[1..$p] OF $kind; (* u *)
END_VAR
${constants}VAR
    x : ARRAY[1..$n] OF $kind; (* memory *)
    after : ARRAY[1..$n] OF $kind;
    miss : ARRAY[1..$q] OF $kind;
    total : $kind;
    i : INT;
    j : INT;
END_VAR

$body
END_FUNCTION_BLOCK
""")
