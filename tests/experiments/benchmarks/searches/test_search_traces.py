"""What searches found is kept in a file, and searches that ended too early begin again."""

import numpy as np
import pytest

from experiments.benchmarks.searches.search_traces import ProblemTraces, Record, Trace


def trace(values, each=1, enough=0.0):
    counts = each * np.arange(1.0, len(values) + 1)
    return Trace.of(values, counts, 0.1 * counts, enough)


def test_a_trace_holds_the_best_so_far():
    one = trace([np.inf, 3.0, 5.0, 2.0, 2.0], each=3)
    assert (one.spent, one.best, one.total, one.least) == ([6.0, 12.0], [3.0, 2.0], 15.0, 2.0)
    np.testing.assert_array_equal(
        one.at(np.array([2, 3, 6, 11, 12, 99])), [np.inf, np.inf, 3, 3, 2, 2]
    )
    assert one.until(3.0) == (6.0, pytest.approx(0.6)) and one.until(1.0) == (np.inf, np.inf)


@pytest.mark.parametrize("values", [[], [np.inf, np.inf]])
def test_a_search_that_finds_nothing_has_no_value(values):
    one = trace(values)
    assert one.least == np.inf and one.total == len(values)
    assert one.at(np.array([1, 9])).tolist() == [np.inf, np.inf]


def test_searches_that_ended_above_a_better_value_begin_again():
    found = ProblemTraces(2, 5.0, (0.0, 0.0), (0.0, 0.0))
    assert found.lacks("a", 0)
    found.put("a", 0, trace([6.0, 4.99], enough=5.005))
    found.put("b", 0, trace([7.0], enough=5.005))  # it used all its evaluations
    assert found.known == 4.99 and not found.lacks("a", 0) and not found.lacks("b", 0)
    found.put("b", 1, trace([4.0], enough=4.995))
    assert found.known == 4.0 and found.lacks("a", 0) and not found.lacks("b", 0)
    found.put("a", 0, trace([4.5], enough=4.004))
    assert not found.lacks("a", 0) and found.lacks("a", 1) and len(found.traces["a"]) == 1


def test_seeds_are_not_left_out():
    with pytest.raises(ValueError, match="seed: a has 0 of them, received 1"):
        ProblemTraces(2, 5.0, (0.0, 0.0), (0.0, 0.0)).put("a", 1, trace([4.0]))


def test_a_record_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "kept.json"
    record = Record.read(path, 10)
    assert record == Record(10)
    record.problems["p"] = ProblemTraces(2, 5.0, (1.0, 2.5), (0.1, 0.3))
    record.problems["p"].put("a", 0, trace([6.0, 5.0], enough=5.005))
    record.problems["p"].put("b", 0, trace([np.inf]))
    record.problems["nowhere"] = ProblemTraces(3, np.inf, (1.0, 2.5), (0.1, 0.3))
    record.write(path)
    assert Record.read(path, 10) == record
    with pytest.raises(ValueError, match="evaluations: .* has 10 of them, received 11"):
        Record.read(path, 11)


def test_without_a_file_nothing_is_kept():
    record = Record.read(None, 10)
    record.write(None)
    assert record == Record(10)
