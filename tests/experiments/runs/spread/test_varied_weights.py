import numpy as np
import pytest

from experiments.runs.spread.varied_weights import listed_values, sampled_designs


def test_words_are_values_by_name():
    assert listed_values(["a=1,2e3", "b=0"]) == {"a": (1.0, 2000.0), "b": (0.0,)}
    with pytest.raises(
        ValueError, match="vary: needs NAME=VALUE or NAME=VALUE,VALUE,... with finite numbers"
    ):
        listed_values(["a=1,two"])


def test_a_grid_has_all_pairs_and_a_random_sample_lies_between():
    varied = {"a": (0.0, 1.0, 100.0), "b": (2.0, 3.0)}
    grid = sampled_designs(varied, 0, 0)
    assert len(set(zip(np.asarray(grid["a"]), np.asarray(grid["b"]), strict=True))) == 6
    sample = sampled_designs(varied, 50, 0)
    drawn = np.asarray(sample["a"])
    assert drawn.size == 50 and drawn.min() >= 1 and drawn.max() <= 100  # not below the least > 0
    with pytest.raises(ValueError, match="samples: needs at least 0"):
        sampled_designs(varied, -1, 0)
