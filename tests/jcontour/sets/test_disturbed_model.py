"""Models under disturbances in a box."""

import numpy as np
import pytest

from jcontour.sets.responses import DisturbedModel


def test_disturbances_are_put_side_by_side(slide):
    wide = slide.with_disturbance([0.5, 0.7])
    np.testing.assert_array_equal(wide.E[:, 1], [0.5, 0.7])
    assert wide.disturbances == 2


def test_signals_have_a_limit_each_or_one_for_all(slide):
    rows = slide.state_signals(["x", "v"], np.eye(2), [1.0, 2.0])
    assert [(row.name, row.limit) for row in rows] == [("x", 1.0), ("v", 2.0)]
    (control,) = slide.control_signals(4.0)
    assert control.name == "control" and control.control.tolist() == [1.0]
    two = DisturbedModel.of(np.eye(2), np.eye(2), np.eye(2)).control_signals([1.0, 2.0])
    assert [row.name for row in two] == ["control 1", "control 2"]


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        (([[1.0, 2.0]], [1.0], [1.0]), "A: needs to be square"),
        ((np.eye(2), [1.0], [1.0, 0.0]), r"B: needs shape \(2, p\)"),
        ((np.eye(2), [1.0, 1.0], [[1.0]]), r"E: needs shape \(2, q\)"),
        ((np.eye(2), [1.0, np.nan], [1.0, 0.0]), "B: every entry needs to be finite"),
    ],
)
def test_bad_matrices_are_named(matrices, message):
    with pytest.raises(ValueError, match=message):
        DisturbedModel.of(*matrices)
