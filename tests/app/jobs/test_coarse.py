"""Coordinates that are too coarse, for circles and lines whose rounding is known."""

from pathlib import Path

import numpy as np
import pytest

from jcontour.app import machines
from jcontour.app.catalogue.choices import machine_named
from jcontour.app.jobs.job import from_file
from jcontour.app.jobs.motion_laws import Coarse, coarse_coordinates
from jcontour.app.jobs.pace import Pace
from jcontour.geometry.contours import polyline

EXAMPLE = str(Path(machines.__file__).parent / "example.json")
PACE = Pace(machine_named(EXAMPLE), None, None)  # 1.25 m/s^2 and 62.5 m/s^3 on Y


def circle(step: float, radius: float = 5e-3, chord: float = 0.1e-3):
    """Points of a circle, a chord apart, rounded to a step [m]."""
    angle = np.linspace(0.0, 2 * np.pi, int(2 * np.pi * radius / chord))
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.round(points / step) * step if step else points


def coarse(points, tolerance: float = 2e-6, feed: float = 0.05) -> Coarse | None:
    path, pace = polyline(points), PACE._replace(corner_tolerance=tolerance)
    speed = np.full(path.rate.size, feed)
    return coarse_coordinates(path, speed, speed > 0, pace)


@pytest.mark.parametrize("step", [2.54e-6, 10e-6, 25.4e-6])
def test_the_step_of_the_coordinates_is_found(step):
    """In millimetres and in inches; a place of the whole off the steps does not matter."""
    for points in (circle(step), circle(step) + 0.123456789e-3):
        rounding = coarse(points)
        assert rounding is not None
        assert rounding.step == pytest.approx(step) and rounding.moves > 0.8 * len(points)
    assert coarse(circle(step), step) is None


@pytest.mark.parametrize(
    "points",
    [
        circle(0.0),
        circle(1e-6),  # finer than the tolerance
        circle(100e-6),  # a grid that is meant
        circle(10e-6, radius=50e-3, chord=2e-3),  # so long that the rounding takes no time
        np.stack([np.arange(200) * 0.1e-3, np.zeros(200)], axis=1),  # straight on
        np.array([[0, 0], [5e-3, 0], [5e-3, 5.01e-3], [0, 5.01e-3]]),  # corners that are meant
    ],
)
def test_where_rounding_takes_no_time_nothing_is_said(points):
    assert coarse(points) is None


def test_a_slow_tool_does_not_mind_the_rounding():
    """pi v sqrt(a/A) = 6.3 um and pi v cbrt(a/J) = 14 um of chord at 1 mm/s."""
    assert coarse(circle(10e-6), feed=1e-3) is None


@pytest.mark.parametrize("name", ["circle.ngc", "circle.csv"])
def test_who_follows_the_advice_is_quicker(name, tmp_path):
    points = [(f"{x:.2f}", f"{y:.2f}") for x, y in 1e3 * circle(0.0)]
    program = "G21 G90 F3000 G1\n" + "\n".join(f"X{x} Y{y}" for x, y in points)
    table = "\n".join(",".join(point) for point in points)
    path = tmp_path / name
    path.write_text(table if path.suffix == ".csv" else program)
    first = from_file(path, PACE)
    (advised,) = first.program.warnings
    assert advised.startswith("coordinates are rounded to 10 um, the tolerance is 2 um")
    tolerance = 1e-6 * float(advised.split("--corner-tolerance-um ")[1].split()[0])
    second = from_file(path, PACE._replace(corner_tolerance=tolerance))
    assert second.samples < 0.5 * first.samples
    assert not any(one.startswith("coordinates") for one in second.program.warnings)
    assert from_file(path, PACE._replace(feed_law="trapezoidal")).program.warnings == ()
