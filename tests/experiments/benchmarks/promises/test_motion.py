from dataclasses import replace

import numpy as np

from experiments.benchmarks.promises import motion
from experiments.benchmarks.promises.kept_promises import Checked
from experiments.benchmarks.promises.motion import MotionBench, broken, measured, show
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import console_of

KEPT = Checked(8, "lines", 3, 1.0, 0.5, 1 + 1e-10, 1.0, 0.9, 1.0, 0.1)


def test_a_promise_is_broken_above_its_limit_or_where_nothing_is_known():
    assert broken(KEPT) == []
    assert broken(KEPT._replace(jerk=1 + 1e-8, stopping=np.nan)) == ["jerk", "stopping"]
    assert broken(KEPT._replace(kind="lines and arcs", stopping=np.nan)) == []


def test_kept_paths_are_not_run_again(tmp_path, monkeypatch):
    run = []

    def without_processes(seeds, tell):
        run.extend(seeds)
        yield from (KEPT._replace(seed=seed) for seed in seeds)

    monkeypatch.setattr(motion, "_run", without_processes)
    flags = Bench("motion", seeds=3, first_seed=4, keep=tmp_path / "paths.csv")
    assert measured(flags, print).kept == 0 and run == [4, 5, 6]
    again = measured(replace(flags, seeds=5), print)
    assert run == [4, 5, 6, 7, 8] and again.kept == 3
    assert [row.seed for row in again.paths] == [4, 5, 6, 7, 8]


def test_what_is_printed(capsys):
    slower = KEPT._replace(seed=77, stopping=1.5, seconds=0.3)
    show(console_of(), MotionBench([KEPT, slower], 2.0))
    printed = capsys.readouterr().out
    row = next(line for line in printed.splitlines() if line.lstrip().startswith("lines"))
    assert row.split()[1:3] == ["2", "1"] and "0.5" in row
    assert "(77)" in printed and "2 paths, seeds 8 to 77, 2 of them now, in 2 s" in " ".join(
        printed.split()
    )
