"""Parts of the comparison, against geometry in closed form."""

import numpy as np
from scipy.spatial import KDTree

from experiments.benchmarks.promises.finishing_program import Side
from experiments.benchmarks.promises.program import ProgramBench, Row, _curve, _distance, show
from jcontour.app.reports.tables import console_of


def test_distance_from_a_circle_in_points():
    angle = np.linspace(0.0, 2 * np.pi, 4001)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius = np.array([0.9, 0.999, 1.0, 1.0001, 1.2])
    place = radius[:, None] * np.stack([np.cos(radius * 3), np.sin(radius * 3)], axis=1)
    found = _distance(KDTree(circle), place)
    np.testing.assert_allclose(found, np.abs(radius - 1), atol=(2 * np.pi / 4000) ** 2 / 8)


def test_distance_from_either_side_of_a_corner():
    corners = 1e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    curve = _curve([Side(*corners[:2], np.zeros(3)), Side(*corners[1:], np.zeros(3))])
    place = corners[1] + 1e-6 * np.array([[2.0, 1.0], [-1.0, -3.0], [4.0, -3.0]])
    np.testing.assert_allclose(_distance(curve, place), [2e-6, 3e-6, 5e-6], rtol=1e-9)


def test_distance_within_a_sharp_corner_is_that_of_the_nearer_side():
    """The nearest points are those of the first side, 2.5 um apart; the second has three points."""
    corners = 1e-6 * np.array([[0.0, 0.0], [1000.0, 0.0], [991.5, 2.0]])
    curve = _curve([Side(*corners[:2], np.zeros(3)), Side(*corners[1:], np.zeros(3))])
    along = (corners[2] - corners[1]) / np.linalg.norm(corners[2] - corners[1])
    place = corners[1] + 1e-6 * np.array([[2.0], [2.5], [3.0]]) * along
    place += 0.1e-6 * np.array([-along[1], along[0]])  # below it, above the first side
    np.testing.assert_allclose(_distance(curve, place), 0.1e-6, rtol=1e-9)


def test_ratios_stand_beside_constant_feed(capsys):
    planned = Row("jerk-limited, 2 um", 4.0, 1e-6, 0.3e-6, 20e-6, 2e-6, 50.0)
    constant = Row("constant feed", 4.0, 9e-6, 0.7e-6, 35e-6, 9e-6, 100.0)
    show(console_of(), ProgramBench(2000, [planned, constant], 1.0, 7.0))
    printed = capsys.readouterr().out
    row = next(line for line in printed.splitlines() if "constant feed" in line)
    assert row.split()[-2:] == ["9.0", "4.5"]
    assert "2000 chords" in printed
