"""What searches found is kept in a file, and starts that stopped too early are dropped."""

import numpy as np
import pytest

from experiments.benchmarks.search_traces import ProblemTraces, Record, Trace


def trace(values, each=1):
    counts = each * np.arange(1.0, len(values) + 1)
    return Trace.of(values, counts, 0.1 * counts)


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


def test_searches_that_stopped_above_a_better_value_are_dropped():
    found = ProblemTraces(2, 5.0, (0.0, 0.0), (0.0, 0.0))
    assert found.add({"a": trace([6.0, 4.99]), "b": trace([7.0])}) and found.seeds == 1
    assert not found.add({"a": trace([4.0]), "b": trace([7.0])})
    assert (found.known, found.seeds) == (4.0, 0)
    assert found.add({"a": trace([4.0]), "b": trace([7.0])}) and found.seeds == 1


def test_a_record_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "kept.json"
    record = Record.read(path, 10)
    assert record == Record(10)
    record.problems["p"] = ProblemTraces(2, 5.0, (1.0, 2.5), (0.1, 0.3))
    record.problems["p"].add({"a": trace([6.0, 5.0]), "b": trace([np.inf])})
    record.problems["nowhere"] = ProblemTraces(3, np.inf, (1.0, 2.5), (0.1, 0.3))
    record.write(path)
    assert Record.read(path, 10) == record
    with pytest.raises(ValueError, match="evaluations: .* has 10 of them, received 11"):
        Record.read(path, 11)


def test_without_a_file_nothing_is_kept():
    record = Record.read(None, 10)
    record.write(None)
    assert record == Record(10)
