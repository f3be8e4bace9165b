"""The C program that replays a recorded run through an exported law, and a plan read from a file.

Both are for a computer with files, to try the law; the drive needs neither.
"""

from collections.abc import Sequence
from string import Template
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.export.code_text import heading, literal
from jcontour.export.drive_law import DriveLaw, DrivePlan


class Units(NamedTuple):
    """Units of what a law gives and takes: of every control, and of each measurement."""

    control: str
    measured: tuple[str, ...]


def numbers_file(names: Sequence[str], columns: Float[np.ndarray, "T c"]) -> str:
    """CSV with a line of names; every number reads back to the last bit."""
    lines = [",".join(literal(value) for value in row) for row in columns]
    return "\n".join([",".join(names), *lines]) + "\n"


def plan_file(law: DriveLaw, plan: DrivePlan, units: Units) -> str:
    """Text of `plan.csv`: a line for every sample, k, t [s], f, r, F row by row, D row by row, m.

    Names end in their units. A gain F is one per unit of what it remembers, as the law names that.
    """
    parts = [plan.f, plan.r]
    names = _named("f", law.inputs * (units.control,)) + _named("r", units.measured)
    for name, sets, signals in (("F", plan.F, law.names), ("D", plan.D, units.measured)):
        if sets is not None:
            parts.append(sets[plan.used].reshape(plan.steps, -1))
            columns = enumerate(law.inputs * signals, start=1)
            names += [heading(f"{name}{k}", units.control, per=one) for k, one in columns]
    if plan.m is not None:
        parts.append(plan.m)
        entries = enumerate(law.clamped, start=1)
        names += [heading(f"m{k}", law.names[entry]) for k, entry in entries]
    rows = numbers_file(names, np.concatenate(parts, axis=1)).splitlines()
    lines = [f"{k},{literal(k * law.dt)},{row}" for k, row in enumerate(rows[1:])]
    return "\n".join([f"k,t_s,{rows[0]}", *lines]) + "\n"


def replay_file(y: Float[np.ndarray, "T q"], u: Float[np.ndarray, "T p"], units: Units) -> str:
    """Text of `replay.csv`: measurements of a run, and their controls; names end in units."""
    names = _named("y", units.measured) + _named("u", u.shape[1] * (units.control,))
    return numbers_file(names, np.concatenate([y, u], axis=1))


def _named(letter: str, units: Sequence[str]) -> list[str]:
    return [heading(f"{letter}{k}", unit) for k, unit in enumerate(units, start=1)]


def c_replay() -> str:
    """Text of `replay.c`: largest difference to the recorded controls, and nanoseconds a step."""
    return _REPLAY


def c_plan_reader(plan: DrivePlan) -> str:
    """Text of `plan.c` for a plan too long for tables: it reads `plan.csv` line by line."""
    offset, members = 2, []  # after k and t
    for name, size in (
        ("control", plan.f.shape[1]),
        ("measured", plan.r.shape[1]),
        ("feedback", 0 if plan.F is None else plan.F[0].size),
        ("direct", 0 if plan.D is None else plan.D[0].size),
        ("kept", 0 if plan.m is None else plan.m.shape[1]),
    ):
        if size:
            members.append(f"    sample.{name} = &numbers[{offset}];")
        offset += size
    return _PLAN_READER.substitute(count=offset, members="\n".join(members))


_REPLAY = """\
/*
 * Replays a recorded run: the same measurements, and the controls that came of them.
 *
 *   cc -std=c99 -Wall -Wextra -pedantic -O2 -ffp-contract=off -o replay *.c
 *   ./replay replay.csv          largest difference, nanoseconds a step
 *   ./replay replay.csv print    every control as well
 */
#include <stdio.h>
#include <time.h>

#include "controller.h"

enum { TIMED = 2000000 };

static int numbers(FILE *file, int count, double *values)
{
    for (int i = 0; i < count; i++) {
        if (fscanf(file, "%lf,", &values[i]) != 1) {
            return 0;
        }
    }
    return 1;
}

static double step_time(void)
{
    drive_controller controller;
    drive_sample sample = drive_plan(0);
    real y[DRIVE_MEASURED] = {0}, u[DRIVE_INPUTS];
    volatile real seen = 0;
    drive_init(&controller);
    clock_t before = clock();
    for (long k = 0; k < TIMED; k++) {
        drive_step(&controller, &sample, y, u);
        seen = u[0];
    }
    (void)seen;
    return (double)(clock() - before) / CLOCKS_PER_SEC / TIMED;
}

int main(int count, char **words)
{
    double row[DRIVE_MEASURED + DRIVE_INPUTS], largest = 0.0;
    real y[DRIVE_MEASURED], u[DRIVE_INPUTS];
    drive_controller controller;
    FILE *file = fopen(count > 1 ? words[1] : "replay.csv", "r");
    long k;
    if (file == NULL) {
        fprintf(stderr, "replay.csv: cannot be read\\n");
        return 2;
    }
    while ((k = fgetc(file)) != '\\n' && k != EOF) {
        /* the line of names */
    }
    drive_init(&controller);
    for (k = 0; numbers(file, DRIVE_MEASURED + DRIVE_INPUTS, row); k++) {
        drive_sample sample = drive_plan(k);
        for (int i = 0; i < DRIVE_MEASURED; i++) {
            y[i] = (real)row[i];
        }
        drive_step(&controller, &sample, y, u);
        for (int i = 0; i < DRIVE_INPUTS; i++) {
            double apart = (double)u[i] - row[DRIVE_MEASURED + i];
            apart = apart < 0 ? -apart : apart;
            if (!(apart <= largest)) {
                largest = apart; /* a NaN stays */
            }
            if (count > 2) {
                printf("%.17g%c", (double)u[i], i + 1 < DRIVE_INPUTS ? ' ' : '\\n');
            }
        }
    }
    fclose(file);
    printf("%ld samples, largest difference %.3g, %.1f ns a step\\n", k, largest,
           1e9 * step_time());
    return 0;
}
"""

_PLAN_READER = Template("""\
/*
 * The plan is too long for tables: this reads plan.csv, one line a sample, in order.
 * On a drive, let its host send the numbers of a line instead, in the same order.
 */
#include <stdio.h>

#include "controller.h"

enum { COUNT = $count };

static real numbers[COUNT];
static FILE *file;
static long next_sample = -1;

static void rewound(void)
{
    int letter;
    file = file ? file : fopen("plan.csv", "r");
    if (file) {
        rewind(file);
        while ((letter = fgetc(file)) != '\\n' && letter != EOF) {
            /* the line of names */
        }
    }
    next_sample = 0;
}

drive_sample drive_plan(long k)
{
    drive_sample sample;
    k = k < 0 ? 0 : k < DRIVE_STEPS ? k : DRIVE_STEPS - 1; /* the last one is held */
    if (next_sample < 0 || k < next_sample - 1) {
        rewound();
    }
    while (file && next_sample <= k) {
        for (int i = 0; i < COUNT; i++) {
            double value;
            if (fscanf(file, "%lf,", &value) != 1) {
                value = 0.0; /* the plan has ended */
            }
            numbers[i] = (real)value;
        }
        next_sample++;
    }

$members
    return sample;
}
""")
