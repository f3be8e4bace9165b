"""`jcontour bench motion`: limits and tolerances of motions on random toolpaths, on all cores."""

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Console

from experiments.benchmarks.kept_rows import opened, write
from experiments.benchmarks.promises.kept_promises import Checked, checked
from experiments.benchmarks.promises.random_paths import KINDS, WITH_ARCS
from jcontour.app.flags.others import Bench
from jcontour.app.reports import tables

SLACK = 1e-9  # relative, of every promise
PROMISES = ("feed", "speed", "acceleration", "jerk", "deviation", "stopping")
AT_ONCE = 8  # paths that a process is given
TOLD = 500  # paths between two lines of progress


@dataclass(frozen=True)
class MotionBench:
    """One row for every path.

    Attributes:
        paths: in order of their seeds.
        seconds: that all of them together took [s], without those that were kept.
        kept: how many come from the file of an earlier run.
    """

    paths: list[Checked]
    seconds: float
    kept: int = 0


def measured(flags: Bench, tell: Callable[[str], None]) -> MotionBench:
    """Paths of seeds one after the other, in a process for each core; those kept are not run.

    Raises:
        ValueError: the file to keep them is none of this benchmark.
    """
    seeds = range(flags.first_seed, flags.first_seed + flags.seeds)
    began = time.perf_counter()
    if flags.keep is None:
        rows = list(_run(seeds, tell))
        return MotionBench(sorted(rows), time.perf_counter() - began)
    known, file = opened(flags.keep, Checked, "random toolpaths")
    rows = list({row.seed: row for row in known if row.seed in seeds}.values())
    kept = len(rows)
    with file:
        for row in _run(sorted(set(seeds) - {row.seed for row in rows}), tell):
            write(file, [row])
            rows.append(row)
    return MotionBench(sorted(rows), time.perf_counter() - began, kept)


def _run(seeds: Sequence[int], tell: Callable[[str], None]) -> Iterator[Checked]:
    if not seeds:
        return
    processes = min(os.cpu_count() or 1, len(seeds))
    # a process that starts afresh: threads of JAX do not survive a fork
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        found = pool.imap_unordered(checked, seeds, chunksize=AT_ONCE)
        for number, row in enumerate(found, start=1):
            if broken(row):
                tell(f"seed {row.seed}: exceeds {', '.join(broken(row))}")
            if number % TOLD == 0:
                tell(f"{number} paths")
            yield row


def broken(row: Checked) -> list[str]:
    """Promises that a motion breaks; a ratio that is not finite breaks one, too."""
    known = [name for name in PROMISES if name != "stopping" or row.kind not in WITH_ARCS]
    return [name for name in known if not getattr(row, name) <= 1 + SLACK]


def show(console: Console, result: MotionBench) -> None:
    """One line for every kind of path: the worst ratio of each promise, and its seed."""
    cells = []
    for kind in KINDS:
        some = [row for row in result.paths if row.kind == kind]
        if some:
            count = sum(bool(broken(row)) for row in some)
            worst = [_worst(some, name) for name in PROMISES]
            cells.append([kind, str(len(some)), str(count), *worst])
    columns = ["path", "number", "broken", *PROMISES]
    console.print(tables.plain_table("Random toolpaths", columns, cells, text_columns=1))
    seconds = [row.seconds for row in result.paths]
    tables.say(
        console,
        "each: the greatest over its limit, less 1, and the seed of its path; stopping: duration "
        "over that with a stop in every corner",
        f"{len(seconds)} paths, seeds {result.paths[0].seed} to {result.paths[-1].seed}, "
        f"{len(seconds) - result.kept} of them now, in {result.seconds:.3g} s; to plan one takes "
        f"{np.median(seconds):.2g} s, at most {max(seconds):.2g} s",
    )


def _worst(rows: list[Checked], name: str) -> str:
    known = [row for row in rows if np.isfinite(getattr(row, name))]
    if not known:
        return "-"
    worst = max(known, key=lambda row: getattr(row, name))
    return f"{getattr(worst, name) - 1:.2g}\n({worst.seed})"
