import numpy as np

from jcontour.simulation.metrics import Metrics
from tuning.history import Evaluated, next_start, rank, sound
from tuning.outcome import Outcome

NAMES = [name for name in Metrics.__dataclass_fields__ if name != "diverged"]


def row(start, z, error, violation=-1.0, diverged=False):
    values = {name: np.full((1, 1), error) for name in NAMES}
    metrics = Metrics(**values, diverged=np.full((1, 1), diverged))
    return Evaluated(start, np.array([z]), error, violation, Outcome(metrics), diverged)


def chosen(*rows, prices=()):
    found = next_start(rows, np.array(prices, float))
    return None if found is None else float(found[0])


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
