"""Rates beside those that were stored last for the same device."""

import io
from dataclasses import dataclass

import numpy as np
import pytest
from rich.console import Console

from experiments.benchmarks import stored_results
from experiments.benchmarks.stored_results import kept

MACHINE = {"devices": "1 x card", "versions": "jax 1", "date": "today"}


def test_a_slower_row_is_marked_and_other_devices_do_not_count(tmp_path, monkeypatch):
    path = tmp_path / "results.json"
    stored_results.add(path, "lq", MACHINE, {"forward": 100.0, "gradient": 50.0})
    stored_results.add(path, "lq", {**MACHINE, "devices": "2 x card"}, {"forward": 1e9})
    monkeypatch.setattr(stored_results.read, "__defaults__", (path,))
    table = stored_results.changes("lq", MACHINE, {"forward": 80.0, "gradient": 50.0})
    page = io.StringIO()
    Console(file=page, width=120).print(table)
    lines = [line.split() for line in page.getvalue().splitlines()]
    assert "forward 100 80 0.80 slower".split() in lines
    assert "gradient 50 50 1.00".split() in lines
    assert stored_results.changes("qp", MACHINE, {}) is None


def test_what_is_stored_names_its_device():
    for results in stored_results.read().values():
        for one in results:
            assert one["devices"] and one["versions"] and one["date"] and one["rates"]


@dataclass(frozen=True)
class Row:
    name: str
    ratio: float
    sound: bool
    values: list[float]


def run(ran):
    def rows(seed, name):
        ran.append((seed, name))
        return [Row(name, 0.1 + 0.2 * seed, seed > 0, [np.inf, np.nan])]

    return rows


def test_a_second_run_goes_on_with_the_same_bits(tmp_path):
    """A last line that was cut off is made again."""
    path, ran = tmp_path / "rows.json", []
    keys = [(seed, name) for seed in (0, 1) for name in ("a", "b")]
    before = kept(path, Row, keys, run(ran))
    assert ran == keys
    path.write_text(path.read_text()[:-9])
    ran.clear()
    after = kept(path, Row, [*keys, (2, "a")], run(ran))
    assert ran == [(1, "b"), (2, "a")]
    assert str(after[:4]) == str(before)  # NaN is no other NaN
    assert str(kept(None, Row, keys, run(ran))) == str(before)


@pytest.mark.parametrize("text", ["a,b\n", '[[0], [{"x": 1}]]\n', "7\n"])
def test_other_files_are_refused(tmp_path, text):
    path = tmp_path / "rows.json"
    path.write_text(text)
    with pytest.raises(ValueError, match="keep: .*rows.json"):
        kept(path, Row, [(0, "a")], run([]))
    assert path.read_text() == text
