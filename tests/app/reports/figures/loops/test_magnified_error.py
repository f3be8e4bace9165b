"""The contour error, drawn larger than it is."""

import numpy as np
import pytest

from jcontour.app.reports.figures.loops.magnified_error import magnification


@pytest.mark.parametrize(
    ("largest", "factor"), [(1e-3, 500.0), (0.1, 5.0), (0.5, 1.0), (20.0, 1.0), (0.0, 1.0)]
)
def test_magnification_is_a_round_number(largest, factor):
    desired = np.array([[0.0, 0.0], [10.0, 3.0]])
    assert magnification(desired, np.array([[0.0, largest], [np.nan, 0.0]])) == factor


def test_rounding_is_no_error_to_magnify():
    """On a line along an axis the tool is off by what coordinates are rounded to."""
    desired = np.array([[1.0, 900.0], [3.0, 900.0]])
    assert magnification(desired, np.array([[0.0, np.spacing(900.0)], [0.0, 0.0]])) == 1.0
