import numpy as np

from experiments.benchmarks.motion import MotionBench, broken, show
from experiments.benchmarks.random_paths import Checked
from experiments.reports.tables import console_of

KEPT = Checked(8, "lines", 3, 1.0, 0.5, 1 + 1e-10, 1.0, 0.9, 1.0, 0.1)


def test_a_promise_is_broken_above_its_limit_or_where_nothing_is_known():
    assert broken(KEPT) == []
    assert broken(KEPT._replace(jerk=1 + 1e-8, stopping=np.nan)) == ["jerk", "stopping"]
    assert broken(KEPT._replace(kind="lines and arcs", stopping=np.nan)) == []


def test_what_is_printed(capsys):
    slower = KEPT._replace(seed=77, stopping=1.5, seconds=0.3)
    show(console_of(), MotionBench([KEPT, slower], 2.0))
    printed = capsys.readouterr().out
    row = next(line for line in printed.splitlines() if line.lstrip().startswith("lines"))
    assert row.split()[1:3] == ["2", "1"] and "0.5" in row
    assert "(77)" in printed and "2 paths in 2 s" in printed
