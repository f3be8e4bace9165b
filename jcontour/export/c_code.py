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
        "    const real *control; /* f: fed forward */",
        _member("memory", plan.w, "w: fed forward into the memory"),
    ]
    return _HEADER.substitute(
        notes=_comment(notes),
        real=TYPES[precision],
        memory=max(law.states, 1),
        measured=law.measured,
        inputs=law.inputs,
        period=literal(law.dt, precision),
        steps=plan.steps,
        entries=_comment([f"memory[{k}]  {name}" for k, name in enumerate(law.names)]),
        sample="\n".join(term for term in terms if term),
    )


def c_source(law: DriveLaw, plan: DrivePlan, precision: Precision) -> str:
    """Text of `controller.c`: `drive_init` and `drive_step`."""
    start = np.zeros(1) if law.states == 0 else law.start
    constants = [("START", start, "memory before the first sample")]
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
        )
        if matrix is not None
    ]
    tables = "\n\n".join(_constant(*one, precision) for one in constants)
    body = [*_correction(law), *_control(law, plan), *_prediction(law, plan)]
    text = "\n".join(f"    {line}".rstrip() for line in body)
    helpers = "\n".join(code for name, code in _HELPERS.items() if f"{name}(" in text)
    return _SOURCE.substitute(tables=tables, helpers=helpers, body=text)


def c_plan(plan: DrivePlan, name: str, precision: Precision) -> str:
    """Text of `plan.c`: the plan of one path as constant tables."""
    rows = plan.f.shape[1]
    tables = [_constant("CONTROL", plan.f, "f, a row for every sample", precision)]
    members = [f"    sample.control = &CONTROL[{rows} * k];"]
    for word, sets, told in (("FEEDBACK", plan.F, "F"), ("DIRECT", plan.D, "D")):
        if sets is not None:
            tables.append(_constant(word, sets, f"{told}, {len(sets)} set(s)", precision))
            size = sets[0].size
            members.append(f"    sample.{word.lower()} = &{word}[{size} * {_set(plan)}];")
    if plan.w is not None:
        tables.append(_constant("MEMORY", plan.w, "w, a row for every sample", precision))
        members.append(f"    sample.memory = &MEMORY[{plan.w.shape[1]} * k];")
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


def _correction(law: DriveLaw) -> list[str]:
    if law.correction is None:
        return []
    return [
        "/* correction: x += L (y - C x) */",
        "real miss[DRIVE_MEASURED];",
        "copy(DRIVE_MEASURED, y, miss);",
        "subtract(DRIVE_MEASURED, DRIVE_MEMORY, C, x, miss);",
        "add(DRIVE_MEMORY, DRIVE_MEASURED, L, miss, x);",
        "",
    ]


def _control(law: DriveLaw, plan: DrivePlan) -> list[str]:
    lines = ["/* control: u = f - F x - D y */", "copy(DRIVE_INPUTS, plan->control, u);"]
    if plan.F is not None:
        lines.append("subtract(DRIVE_INPUTS, DRIVE_MEMORY, plan->feedback, x, u);")
    if plan.D is not None:
        lines.append("subtract(DRIVE_INPUTS, DRIVE_MEASURED, plan->direct, y, u);")
    if np.isfinite(law.limit).any():
        lines.append("limit(DRIVE_INPUTS, LIMIT, u);")
    return [*lines, ""]


def _prediction(law: DriveLaw, plan: DrivePlan) -> list[str]:
    if law.states == 0:
        return ["(void)x; /* this controller remembers nothing */"]
    lines = [
        "/* memory of the next sample: A x + B u + E y + w, as far as they are there */",
        "real next[DRIVE_MEMORY] = {0};",
    ]
    if plan.w is not None:
        lines.append("copy(DRIVE_MEMORY, plan->memory, next);")
    for name, matrix, size, signal in (
        ("A", law.A, "DRIVE_MEMORY", "x"),
        ("B", law.B, "DRIVE_INPUTS", "u"),
        ("E", law.E, "DRIVE_MEASURED", "y"),
    ):
        if matrix is not None:
            lines.append(f"add(DRIVE_MEMORY, {size}, {name}, {signal}, next);")
    return [*lines, "copy(DRIVE_MEMORY, next, x);"]


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
 * C99 without allocation and without a library; nothing global changes.
 */
#ifndef DRIVE_CONTROLLER_H
#define DRIVE_CONTROLLER_H

typedef $real real;

#define DRIVE_PERIOD $period /* s between two samples */
enum {
    DRIVE_MEASURED = $measured, /* numbers in y */
    DRIVE_INPUTS = $inputs,   /* numbers in u */
    DRIVE_MEMORY = $memory,   /* numbers that are remembered */
    DRIVE_STEPS = $steps /* samples of the plan */
};

/*
$entries
 */
typedef struct {
    real memory[DRIVE_MEMORY];
} drive_controller;

/* One sample of the plan; pointers into tables that do not change. */
typedef struct {
$sample
} drive_sample;

/* Memory before the first sample: the axes where the path begins, the load unknown. */
void drive_init(drive_controller *controller);

/* Sample 0 <= k < DRIVE_STEPS of the plan. */
drive_sample drive_plan(long k);

/* Controls u[DRIVE_INPUTS] of one sample from what is measured, y[DRIVE_MEASURED]. */
void drive_step(drive_controller *controller, const drive_sample *plan, const real *y, real *u);

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

$tables

$helpers
void drive_init(drive_controller *controller)
{
    copy(DRIVE_MEMORY, START, controller->memory);
}

void drive_step(drive_controller *controller, const drive_sample *plan, const real *y, real *u)
{
    real *x = controller->memory;

$body
}
""")

_PLAN = Template("""\
/* Plan of $name. */
#include "controller.h"

$tables

drive_sample drive_plan(long k)
{
    drive_sample sample;

$members
    return sample;
}
""")
