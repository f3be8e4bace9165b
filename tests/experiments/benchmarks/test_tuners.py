"""Best values so far, and what a table says of them."""

import numpy as np
import pytest

from experiments.benchmarks import tuners
from experiments.benchmarks.tuners import Trace, TunersBench, measured, show
from experiments.options import Bench
from experiments.reports.tables import console_of


def trace(values, each=1):
    return tuners._trace(values, each, np.arange(1.0, len(values) + 1))


def test_a_trace_holds_the_best_so_far():
    one = trace([np.inf, 3.0, 5.0, 2.0], each=3)
    np.testing.assert_array_equal(one.best, [np.inf, 3.0, 3.0, 2.0])
    np.testing.assert_array_equal(
        one.at(np.array([2, 3, 6, 11, 12, 99])), [np.inf, np.inf, 3, 3, 2, 2]
    )
    assert one.until(3.0) == (6.0, 2.0) and one.until(1.0) == (np.inf, np.inf)


def test_searches_are_compared_with_the_best_of_all():
    traces = {
        ("jcontour", 2): [trace([4.0, 2.0], each=3), trace([2.02], each=3)],
        ("Sobol", 2): [trace([9.0, 8.0, 2.03]), trace([7.0, 6.0])],
    }
    (ours, theirs), curves = tuners._summed_up("p", traces, 10)
    assert (ours.best, ours.reached, ours.evaluations) == (2.0, 2, (3.0, 3.0, 6.0))
    assert (theirs.reached, theirs.evaluations) == (1, (3.0, 3.0, None))
    assert isinstance(curves["Sobol"].middle, np.ndarray)
    assert curves["jcontour"].low[2] == pytest.approx(1.01)


def test_nobody_arrives_where_nothing_is_within_the_limits():
    (row,), curves = tuners._summed_up("p", {("Sobol", 2): [trace([np.inf, np.inf])]}, 10)
    assert (row.reached, row.evaluations, curves) == (0, (None, None, None), {})


def test_the_table_says_who_arrives(capsys):
    traces = {("jcontour", 2): [trace([2.0], each=3)], ("Sobol", 2): [trace([9.0])]}
    rows, _ = tuners._summed_up("p", traces, 10)
    show(console_of(), TunersBench(10, rows))
    printed = capsys.readouterr().out
    assert "1 of 1" in printed and "0 of 1" in printed and "3 to 3" in printed


def test_missing_libraries_are_named_with_what_installs_them(monkeypatch):
    monkeypatch.setattr(tuners, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="uv run --group bench jcontour bench tuners"):
        measured(Bench(what="tuners"), print)


@pytest.mark.parametrize("flag", ["seeds", "evaluations"])
def test_numbers_below_one_are_named(flag):
    with pytest.raises(ValueError, match=f"{flag}: needs at least 1, received 0"):
        measured(Bench(what="tuners", **{flag: 0}), print)


def test_times_belong_to_the_values():
    one = Trace(np.array([1.0, 2.0]), np.array([5.0, 4.0]), np.array([0.1, 0.3]))
    assert one.until(4.5) == (2.0, 0.3)
