"""A drive's law as C99: no allocation, no library, no global that changes.

`controller.h` and `controller.c` are the law, `plan.c` its plan as constant tables. Sums are taken
from the first column to the last: in double, compiled with -ffp-contract=off, the controls are
those of `numpy_code` to the last bit.
"""

from collections.abc import Sequence
from string import Template

import numpy as np

from jcontour.export.code_text import Precision, literal, plain, table, whole_numbers
from jcontour.export.drive_law import DriveLaw, DrivePlan

TYPES: dict[Precision, str] = {"double": "double", "single": "float"}
LARGEST = 1e30  # of a measurement: its products are finite in single precision


def c_header(law: DriveLaw, plan: DrivePlan, notes: Sequence[str], precision: Precision) -> str:
    """Text of `controller.h`: sizes, units, and what the controller was made for.

    Args:
        law: what does not change along the path.
        plan: what does.
        notes: lines for people, any text.
        precision: of all numbers.
    """
    terms = [
        _member("feedback", plan.F, "F, row by row: inputs x memory"),
        _member("direct", plan.D, "D, row by row: inputs x measured"),
        "    const real *control; /* f: controls of the planned run */",
        "    const real *measured; /* r: measurements of the planned run */",
        _member("kept", plan.m, "m: memory with a limit, on the planned run before it"),
    ]
    return _HEADER.substitute(
        notes=_comment(notes),
        real=TYPES[precision],
        memory=max(law.states, 1),
        measured=law.measured,
        inputs=law.inputs,
        period=literal(law.dt, precision),
        largest=literal(LARGEST, precision),
        steps=plan.steps,
        entries=_comment([f"memory[{k}]  {name}" for k, name in enumerate(law.names)]),
        sample="\n".join(term for term in terms if term),
    )


def c_source(law: DriveLaw, plan: DrivePlan, precision: Precision) -> str:
    """Text of `controller.c`: `drive_init` and `drive_step`."""
    constants = []
    if law.correction is not None:
        constants.append(("L", law.correction.L, "observer gain: memory x measured"))
        constants.append(("C", law.correction.C, "measured part of the memory"))
    constants += [
        (name, matrix, words)
        for name, matrix, words in (
            ("A", law.A, "memory x memory"),
            ("B", law.B, "memory x inputs"),
            ("E", law.E, "memory x measured"),
            ("LIMIT", law.limit if np.isfinite(law.limit).any() else None, "of every control, +-"),
            ("MOST", law.clamps if law.clamped.size else None, "of what is remembered, +-"),
        )
        if matrix is not None
    ]
    tables = "\n\n".join(_constant(*one, precision) for one in constants)
    body = [*_departure(), *_correction(law), *_control(law, plan), *_prediction(law)]
    text = "\n".join(f"    {line}".rstrip() for line in body)
    helpers = "\n".join(code for name, code in _HELPERS.items() if f"{name}(" in text)
    parts = [part for part in (tables, helpers) if part]
    return _SOURCE.substitute(parts="\n\n".join(parts), body=text)


def c_plan(plan: DrivePlan, name: str, precision: Precision) -> str:
    """Text of `plan.c`: the plan of one path as constant tables."""
    tables, members = [], []
    for word, rows, told in (
        ("CONTROL", plan.f, "f"),
        ("MEASURED", plan.r, "r"),
        ("KEPT", plan.m, "m"),
    ):
        if rows is None:
            continue
        tables.append(_constant(word, rows, f"{told}, a row for every sample", precision))
        members.append(f"    sample.{word.lower()} = &{word}[{rows.shape[1]} * k];")
    for word, sets, told in (("FEEDBACK", plan.F, "F"), ("DIRECT", plan.D, "D")):
        if sets is not None:
            tables.append(_constant(word, sets, f"{told}, {len(sets)} set(s)", precision))
            size = sets[0].size
            members.append(f"    sample.{word.lower()} = &{word}[{size} * {_set(plan)}];")
    if _set(plan) == "USED[k]":
        used = whole_numbers(plan.used)
        head = "/* gain set of every sample */\nstatic const unsigned short USED[]"
        wide = head.replace("short", "long") if plan.used.max() > 65535 else head
        tables.append(f"{wide} = {{\n{used}\n}};")
    return _PLAN.substitute(
        name=plain(name), tables="\n\n".join(tables), members="\n".join(members)
    )


def _set(plan: DrivePlan) -> str:
    """Gain set of sample k in C: none to choose where there is one, or one for each sample."""
    sets = max(len(one) if one is not None else 1 for one in (plan.F, plan.D))
    if sets == 1:
        return "0"
    return "k" if sets == plan.steps else "USED[k]"


def _departure() -> list[str]:
    return [
        "/* departure from the planned run: z = y - r; the last one where y is no number */",
        "for (int i = 0; i < DRIVE_MEASURED; i++) {",
        "    if (y[i] >= -DRIVE_LARGEST && y[i] <= DRIVE_LARGEST) {",
        "        z[i] = y[i] - plan->measured[i];",
        "    } else {",
        "        lost++;",
        "    }",
        "}",
        "",
    ]


def _correction(law: DriveLaw) -> list[str]:
    if law.correction is None:
        return []
    return [
        "/* correction: e += L (z - C e) */",
        "real miss[DRIVE_MEASURED];",
        "copy(DRIVE_MEASURED, z, miss);",
        "subtract(DRIVE_MEASURED, DRIVE_MEMORY, C, e, miss);",
        "add(DRIVE_MEMORY, DRIVE_MEASURED, L, miss, e);",
        "",
    ]


def _control(law: DriveLaw, plan: DrivePlan) -> list[str]:
    lines = ["/* control: u = f - F e - D z */", "copy(DRIVE_INPUTS, plan->control, u);"]
    if plan.F is not None:
        lines.append("subtract(DRIVE_INPUTS, DRIVE_MEMORY, plan->feedback, e, u);")
    if plan.D is not None:
        lines.append("subtract(DRIVE_INPUTS, DRIVE_MEASURED, plan->direct, z, u);")
    if np.isfinite(law.limit).any():
        lines.append("limit(DRIVE_INPUTS, LIMIT, u);")
    return [*lines, ""]


def _prediction(law: DriveLaw) -> list[str]:
    if law.states == 0:
        return ["(void)e; /* this controller remembers nothing */"]
    lines = ["/* memory of the next sample: A e + B (u - f) + E z, as far as they are there */"]
    if law.B is not None:
        lines += ["real change[DRIVE_INPUTS];", "copy(DRIVE_INPUTS, plan->control, change);"]
        if np.isfinite(law.limit).any():
            lines.append("limit(DRIVE_INPUTS, LIMIT, change);")
        lines += [
            "for (int i = 0; i < DRIVE_INPUTS; i++) {",
            "    change[i] = u[i] - change[i];",
            "}",
        ]
    lines.append("real next[DRIVE_MEMORY] = {0};")
    for name, matrix, size, signal in (
        ("A", law.A, "DRIVE_MEMORY", "e"),
        ("B", law.B, "DRIVE_INPUTS", "change"),
        ("E", law.E, "DRIVE_MEASURED", "z"),
    ):
        if matrix is not None:
            lines.append(f"add(DRIVE_MEMORY, {size}, {name}, {signal}, next);")
    if law.clamped.size:
        lines.append("/* the controller keeps this part of its memory within limits */")
    lines += [f"within({k}, plan->kept, {entry}, next);" for k, entry in enumerate(law.clamped)]
    return [*lines, "copy(DRIVE_MEMORY, next, e);"]


def _member(name: str, matrix: np.ndarray | None, words: str) -> str:
    return "" if matrix is None else f"    const real *{name}; /* {words} */"


def _constant(name: str, values: np.ndarray, words: str, precision: Precision) -> str:
    finite = np.where(np.isfinite(values), values, np.finfo(np.float32).max)
    return (
        f"/* {words} */\nstatic const real {name}[{values.size}] = {{\n"
        f"{table(finite, precision)}\n}};"
    )


def _comment(lines: Sequence[str]) -> str:
    return "\n".join(f" * {plain(line)}".rstrip() for line in lines)


_HEADER = Template("""\
/*
$notes
 *
 * Every sample, in this order: measure y, call drive_step, give u to the drive.
 * A measurement that is no number (NaN, infinite, or beyond DRIVE_LARGEST) is not taken: the axis
 * counts as far from its plan as it was one sample before. drive_step then returns how many are
 * lost; stop the axes where that goes on. Do not compile with -ffast-math, which removes the test.
 * C99 without allocation and without a library; nothing global changes.
 */
#ifndef DRIVE_CONTROLLER_H
#define DRIVE_CONTROLLER_H

typedef $real real;

#define DRIVE_PERIOD $period /* s between two samples */
#define DRIVE_LARGEST $largest /* of a measurement */
enum {
    DRIVE_MEASURED = $measured, /* numbers in y */
    DRIVE_INPUTS = $inputs,   /* numbers in u */
    DRIVE_MEMORY = $memory,   /* numbers that are remembered */
    DRIVE_STEPS = $steps /* samples of the plan */
};

/* What is remembered, each less its value on the planned run:
$entries
 */
typedef struct {
    real memory[DRIVE_MEMORY];
    real departure[DRIVE_MEASURED]; /* of the last measurements, y - r */
} drive_controller;

/* One sample of the plan; pointers into tables that do not change. */
typedef struct {
$sample
} drive_sample;

/* Memory before the first sample: the axes stand where the path begins, see `Start` above. */
void drive_init(drive_controller *controller);

/* Sample k of the plan. Its last one, DRIVE_STEPS - 1, is held: k may go on beyond it. */
drive_sample drive_plan(long k);

/*
 * Controls u[DRIVE_INPUTS] of one sample from what is measured, y[DRIVE_MEASURED].
 * Returns how many measurements are no numbers: 0 where all is well.
 */
int drive_step(drive_controller *controller, const drive_sample *plan, const real *y, real *u);

#endif
""")

_HELPERS = {  # those that the step calls
    "copy": """\
static void copy(int count, const real *from, real *to)
{
    for (int i = 0; i < count; i++) {
        to[i] = from[i];
    }
}
""",
    "add": """\
/* sum += matrix vector, the matrix row by row */
static void add(int rows, int columns, const real *matrix, const real *vector, real *sum)
{
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < columns; j++) {
            sum[i] += matrix[i * columns + j] * vector[j];
        }
    }
}
""",
    "subtract": """\
/* sum -= matrix vector */
static void subtract(int rows, int columns, const real *matrix, const real *vector, real *sum)
{
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < columns; j++) {
            sum[i] -= matrix[i * columns + j] * vector[j];
        }
    }
}
""",
    "within": """\
/* an entry of the memory, less its planned value, kept within the controller's own limit */
static void within(int k, const real *planned, int entry, real *memory)
{
    real least = -MOST[k] - planned[k], most = MOST[k] - planned[k];
    real above = planned[k] > MOST[k] ? MOST[k] : planned[k] < -MOST[k] ? -MOST[k] : planned[k];
    real kept = memory[entry] > most ? most : memory[entry] < least ? least : memory[entry];
    memory[entry] = kept + (planned[k] - above);
}
""",
    "limit": """\
static void limit(int count, const real *most, real *values)
{
    for (int i = 0; i < count; i++) {
        if (values[i] > most[i]) {
            values[i] = most[i];
        } else if (values[i] < -most[i]) {
            values[i] = -most[i];
        }
    }
}
""",
}

_SOURCE = Template("""\
#include "controller.h"

$parts
void drive_init(drive_controller *controller)
{
    for (int i = 0; i < DRIVE_MEMORY; i++) {
        controller->memory[i] = 0;
    }
    for (int i = 0; i < DRIVE_MEASURED; i++) {
        controller->departure[i] = 0;
    }
}

int drive_step(drive_controller *controller, const drive_sample *plan, const real *y, real *u)
{
    real *e = controller->memory, *z = controller->departure;
    int lost = 0;

$body
    return lost;
}
""")

_PLAN = Template("""\
/* Plan of $name. */
#include "controller.h"

$tables

drive_sample drive_plan(long k)
{
    drive_sample sample;
    k = k < 0 ? 0 : k < DRIVE_STEPS ? k : DRIVE_STEPS - 1; /* the last one is held */

$members
    return sample;
}
""")
