import numpy as np
import pytest

from jcontour.app.runs.spread.varied_weights import listed_values, sampled_designs


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
    sample = sampled_designs({"a": (1.0, 10.0, 100.0), "b": (2.0, 3.0)}, 50, 0)
    drawn = np.asarray(sample["a"])
    assert drawn.size == 50 and 1 <= drawn.min() < 2 and 50 < drawn.max() <= 100
    with pytest.raises(ValueError, match="samples: needs at least 0"):
        sampled_designs(varied, -1, 0)


@pytest.mark.parametrize("low", [0.0, -2.0])
def test_a_random_sample_has_no_end_that_is_not_above_zero(low):
    """It would be that of the values above zero, or of a single one."""
    message = f"received {low:g} for kv: give a lower end above zero"
    with pytest.raises(ValueError, match=message):
        sampled_designs({"kp": (1.0, 2.0), "kv": (low, 5.0)}, 20, 0)
    assert sampled_designs({"kv": (low, 5.0)}, 0, 0)["kv"].tolist() == [low, 5.0]
