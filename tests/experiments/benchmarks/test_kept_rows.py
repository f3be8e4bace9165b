"""Rows that go through a file."""

from dataclasses import dataclass

import numpy as np
import pytest

from experiments.benchmarks.kept_rows import kept


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
