"""Lines that several commands print."""

from dataclasses import replace

from experiments.files.results.run_metrics import ContourRead
from experiments.reports.tables import console_of, plain_table, read_line


def test_what_rounding_leaves_of_zero_is_zero():
    read = ContourRead(
        pieces=1,
        length=0.1,
        duration=2.0,
        low=(4.1e-9, -1e-18),
        high=(0.1, 0.0462604),
        ignored=(),
    )
    line = read_line("task", read, ("X", "Y"))
    assert line == "task: 1 move, 100 mm in 2 s, X 0 ... 100, Y 0 ... 46.26 mm"
    stopped = read_line("task", replace(read, stops="1 stop: M3 at line 4"), ("X", "Y"))
    assert stopped.split("\n")[1:] == ["1 stop: M3 at line 4"]
    asked = read_line("task", replace(read, doubts=("line 3: a dwell of 500 s",)), ("X", "Y"))
    assert asked == f"{line}\nline 3: a dwell of 500 s"


def test_a_table_without_names_of_columns_has_no_line_of_them(capsys):
    console_of().print(plain_table("Title", ["", ""], [["one", "1"]]))
    assert [line.split() for line in capsys.readouterr().out.splitlines()][:3] == [
        ["Title"],
        [],
        ["one", "1"],
    ]
