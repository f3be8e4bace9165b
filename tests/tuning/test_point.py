import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.simulation.metrics import Metrics
from tuning.objectives import LEAST, AtMost, Outcome, typical_contour_error, worst_contour_error
from tuning.point import (
    Evaluated,
    evaluate_point,
    evaluate_values,
    next_start,
    objective_value,
    rank,
    sound,
)

START = {"x": jnp.asarray(0.5), "y": jnp.asarray(0.8)}
Z = np.log([0.5, 0.8])


def test_rows_count_by_their_geometric_mean():
    values = np.array([[1e-6, 4e-6], [9e-6, 2e-6]])
    assert objective_value(values) == pytest.approx(6e-6, rel=1e-12)
    assert objective_value(np.zeros((1, 2))) == pytest.approx(LEAST)


@pytest.mark.parametrize("objective", [typical_contour_error, worst_contour_error])
def test_numbers_are_the_stated_ones_and_their_slopes_those_of_differences(
    proportional_problem, loop_peaks, objective
):
    names = {"peak_sensitivity": 1.2, "rms_increment": 1e-5, "rms_tracking_error": 1.0}
    problem = proportional_problem(AtMost(**names), objective, loops=loop_peaks)
    at = lambda z: evaluate_point(problem, START, z)  # noqa: E731
    point, h = at(Z), 1e-6
    assert point.limits.shape == (8,)
    metrics = point.outcome.metrics
    np.testing.assert_allclose(np.exp(point.errors), metrics.rms_contour_error, rtol=1e-12)
    assert point.objective == pytest.approx(float(metrics.rms_contour_error.max()), rel=1e-12)
    gains = np.array([0.5 * 1.0, 0.8 * 0.7]), np.array([0.5 * 0.9, 0.8 * 0.8])
    worst = [max(2 / (2 - gain)) for gain in gains]
    np.testing.assert_allclose(point.limits[:4], 2 * [*np.log(np.array(worst) / 1.2)])
    np.testing.assert_allclose(point.limits[4:6], np.log(metrics.rms_increment[0] / 1e-5))
    assert point.limits[4] > 0 > point.limits[7]  # one that is violated and one that is not
    size = float(problem.references.contour.size[0])
    np.testing.assert_allclose(np.exp(point.departures) * size, metrics.peak_tracking_error[0])
    for name in ("errors", "limits", "departures"):
        differences = [
            (getattr(at(Z + h * e), name) - getattr(at(Z - h * e), name)) / (2 * h)
            for e in np.eye(2)
        ]
        slopes = np.moveaxis(getattr(point.slopes, name), -1, 0)
        np.testing.assert_allclose(slopes, differences, rtol=1e-6, atol=1e-8)
    assert not point.diverged
    assert at(np.log([5.0, 0.8])).diverged  # one plant of the family is enough
    assert at(np.log([1e40, 0.8])).diverged  # not finite


@pytest.mark.parametrize("looked_at", [True, False])
def test_values_alone_are_those_that_come_with_slopes(proportional_problem, loop_peaks, looked_at):
    names = {"rms_increment": 1e-5} | ({"peak_sensitivity": 1.2} if looked_at else {})
    problem = proportional_problem(AtMost(**names), loops=loop_peaks if looked_at else None)
    for gain in (0.5, 5.0, 1e40):
        z = np.log([gain, 0.8])
        alone, point = evaluate_values(problem, START, z), evaluate_point(problem, START, z)
        assert alone.diverged == point.diverged == (gain > 1)
        assert alone.slopes.errors.shape == (*point.errors.shape, 0)
        if gain < 1e9:
            np.testing.assert_allclose(alone.departures, point.departures, rtol=1e-9)
        if not alone.diverged:
            np.testing.assert_allclose(alone.errors, point.errors, rtol=1e-12)
            np.testing.assert_allclose(alone.limits, point.limits, rtol=1e-9)
            error = alone.outcome.metrics.rms_contour_error
            np.testing.assert_allclose(error, point.outcome.metrics.rms_contour_error, rtol=1e-12)


def test_errors_of_zero_have_slopes(proportional_problem):
    problem = proportional_problem(
        objective=lambda outcome: 0.0 * outcome.metrics.rms_contour_error
    )
    point = evaluate_point(problem, START, Z)
    assert not point.diverged
    np.testing.assert_array_equal(point.slopes.errors, 0.0)


def test_an_unstable_loop_is_divergence(proportional_problem, loop_peaks):
    """Gains just above 2 do not leave the circle within its 20 samples."""
    z = np.log([2.01, 0.8])
    assert not evaluate_point(proportional_problem(), START, z).diverged
    point = evaluate_point(proportional_problem(loops=loop_peaks), START, z)
    assert point.diverged and float(point.outcome.loops.spectral_radius.max()) > 1
    assert np.all(point.departures < 0) and np.isfinite(point.slopes.departures).all()


@pytest.mark.parametrize("values", [np.ones((0, 3)), np.ones(3), np.ones((1, 2, 3))])
def test_values_without_rows_are_refused(proportional_problem, values):
    with pytest.raises(ValueError, match="objective: needs rows of values"):
        evaluate_point(proportional_problem(objective=lambda outcome: values), START, Z)


def test_loops_that_are_not_looked_at_cannot_be_limited(proportional_problem):
    problem = proportional_problem(AtMost(peak_sensitivity=2.0))
    with pytest.raises(ValueError, match="peak_sensitivity: .* windows"):
        evaluate_point(problem, START, Z)


NAMES = [name for name in Metrics.__dataclass_fields__ if name != "diverged"]


def row(start, z, error, violation=-1.0, diverged=False):
    values = {name: np.full((1, 1), error) for name in NAMES}
    metrics = Metrics(**values, diverged=np.full((1, 1), diverged))
    return Evaluated(start, np.array([z]), error, violation, Outcome(metrics), diverged)


def chosen(*rows, prices=()):
    z = next_start(rows, np.array(prices, float))
    return None if z is None else float(z[0])


def test_the_least_violation_comes_first_and_then_the_objective():
    rows = [row(0, 0.0, 1.0, 0.2), row(0, 1.0, 5.0, -0.1), row(0, 2.0, 4.0, 5e-7)]
    assert min(rows, key=rank).objective == 4.0
    assert sound([*rows, row(0, 3.0, 0.1, diverged=True)]) == rows


def test_the_next_start_is_the_most_promising_one():
    assert chosen(row(0, 0.0, 10.0), row(-1, 1.0, 3.0), row(-1, 2.0, 2.0)) == 2.0


def test_an_excess_costs_what_the_limits_were_worth():
    rows = row(0, 0.0, 10.0), row(-1, 1.0, 3.0), row(-1, 2.0, 2.0, violation=0.01)
    assert chosen(*rows) == 2.0
    assert chosen(*rows, prices=[1.0, 1000.0]) == 1.0


def test_where_nothing_is_feasible_the_limits_come_first():
    rows = row(0, 0.0, 10.0, 0.3), row(-1, 1.0, 3.0, 0.1), row(-1, 2.0, 0.1, 0.2)
    assert chosen(*rows) == 1.0


def test_points_that_behave_as_one_before_or_began_a_descent_are_left_out():
    assert chosen(row(0, 0.0, 10.0), row(-1, 1.0, 10.5)) is None
    assert chosen(row(0, 0.0, 10.0), row(-1, 1.0, 3.0), row(1, 1.0, 3.0)) is None
    assert chosen(row(0, 0.0, 10.0)) is None


def test_where_everything_diverged_the_least_departure_is_next():
    lost = [row(0, 0.0, 1.0, diverged=True), row(-1, 1.0, 1e9, diverged=True)]
    more = row(-1, 2.0, 1e6, diverged=True), row(-1, 3.0, np.nan, diverged=True)
    assert chosen(*lost, *more) == 2.0
    assert chosen(lost[0]) is None
