import pickle
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, polyline
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.references import along, from_samples
from jcontour.plants.actuation import Delayed
from jcontour.plants.linear_machines import bridgeport
from jcontour.simulation.evaluation import stack_plants, stack_references
from tests.reference_data import numbers_of
from tuning import tuner
from tuning.descents.stabilise import TRIES, loop_radii
from tuning.objectives import (
    AtMost,
    Outcome,
    mean_contour_error,
    mean_tracking_error,
    typical_contour_error,
    worst_contour_error,
)
from tuning.parameters import Chart, Fixed, Positive
from tuning.point import evaluate_point, rank
from tuning.problem import THOROUGH, Problem
from tuning.tuner import FEASIBLE, IN_ONE_STEP, TuneState, _scattered_point, advance, result, tune

DATA = numbers_of("mcnab/tuning")
START = {"x": jnp.asarray(0.3), "y": jnp.asarray(0.3)}
CAREFUL = replace(THOROUGH, starts=1, scatter=0)
QUICK = replace(THOROUGH, starts=2, scatter=4, spread=1.0, steps=20)


def run(problem, start, settings, state=None, save=False):
    state = TuneState() if state is None else state
    states = [state]
    while not state.done:
        state = advance(
            problem, start, settings, pickle.loads(pickle.dumps(state)) if save else state
        )
        states.append(state)
    return states


def same_bits(a, b):
    leaves = [jax.tree.leaves(vars(state)) for state in (a, b)]
    return len(leaves[0]) == len(leaves[1]) and all(
        np.array_equal(x, y, equal_nan=True) for x, y in zip(*leaves, strict=True)
    )


@pytest.fixture(scope="module")
def limited(proportional_problem):
    return proportional_problem(
        AtMost(rms_increment=2e-5, rms_tracking_error=5e-4)
    )  # without the second, standing still is best


@pytest.fixture(scope="module")
def states(limited):
    return run(limited, START, QUICK)


def test_finds_the_constrained_optimum_that_scipy_finds(limited, states):
    tuned = result(limited, START, states[-1])

    @jax.jit
    def numbers(z):
        metrics = limited.metrics({"x": jnp.exp(z[0]), "y": jnp.exp(z[1])})
        return 1e6 * limited.objective(Outcome(metrics))[0, 0], limited.limits(Outcome(metrics))

    wanted = minimize(
        lambda z: float(numbers(z)[0]),
        np.log([0.3, 0.3]),
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda z: -np.asarray(numbers(z)[1])},
        options={"ftol": 1e-12},
    )
    assert wanted.success
    assert 1e6 * float(tuned.outcome.metrics.rms_contour_error.mean()) <= wanted.fun * 1.001
    assert tuned.feasible and tuned.violation <= FEASIBLE
    assert tuned.exceeded == () and "keeps every limit" in repr(tuned)
    np.testing.assert_array_equal(limited.metrics(tuned.weights).diverged, False)


def test_interrupted_anywhere_it_ends_with_the_same_bits(limited, states):
    assert same_bits(run(limited, START, QUICK, save=True)[-1], states[-1])
    middle = len(states) // 2
    again = advance(limited, START, QUICK, pickle.loads(pickle.dumps(states[middle])))
    assert same_bits(again, states[middle + 1])


def test_progress_is_told_after_every_step(limited, states):
    seen = []
    tuned = tune(limited, START, QUICK, seen.append)
    assert len(seen) == len(states) - 1 and seen[-1].done
    assert len(tuned.history) == len(states[-1].history)


def test_limits_out_of_reach_give_the_least_violating_point(proportional_problem):
    problem = proportional_problem(AtMost(rms_increment=1.0, rms_tracking_error=1e-7))
    tuned = tune(problem, START, replace(CAREFUL, steps=3))
    assert not tuned.feasible and tuned.violation > 1
    assert tuned.violation == min(row.violation for row in tuned.history if not row.diverged)
    (limit,) = tuned.exceeded
    errors = np.asarray(tuned.outcome.metrics.rms_tracking_error)
    assert limit[:3] == ("rms_tracking_error", *np.unravel_index(np.argmax(errors), errors.shape))
    assert limit[3:] == pytest.approx((errors.max(), 1e-7), rel=1e-12)
    assert f"rms_tracking_error is {errors.max():.4g}, allowed 1e-07" in repr(tuned)


def test_every_start_diverging_is_an_error(limited):
    with pytest.raises(ValueError, match="every start diverges"):
        tune(
            limited,
            {"x": jnp.asarray(1e30), "y": jnp.asarray(1e30)},
            replace(THOROUGH, starts=3, scatter=2, spread=0.1),
        )


def outcome_from(problem, gain, reach=1.0):
    """From a start that diverges, with scattered points that reach down to gains that do not."""
    start = {"x": jnp.asarray(gain), "y": jnp.asarray(gain)}
    return tune(
        problem,
        start,
        replace(
            THOROUGH,
            starts=2,
            scatter=16,
            spread=reach * float(np.log(gain)) + 1.0,
            steps=10,
        ),
    )


def test_a_start_that_diverges_is_counted_and_another_one_found(proportional_problem):
    tuned = outcome_from(proportional_problem(), 1e17)  # its runs are not finite
    assert tuned.diverged_starts == 1
    assert tuned.diverged_points == sum(row.diverged for row in tuned.history) > 1
    assert {row.start for row in tuned.history} == {-1, 0, 1}
    assert tuned.feasible


def test_a_start_that_runs_away_is_led_back_by_its_runs(proportional_problem):
    """Where the problem does not look at its loops."""
    tuned = outcome_from(proportional_problem(), 5.0)
    assert tuned.diverged_starts == 0 and tuned.stabilised and tuned.feasible
    assert tuned.history[0].diverged


FAR = {"x": jnp.asarray(50.0), "y": jnp.asarray(20.0)}


def test_one_good_end_is_enough_where_not_every_start_is_asked_for(limited):
    enough = replace(QUICK, every_start=False)
    tuned = tune(limited, START, enough)
    assert tuned.stationary and tuned.feasible and {row.start for row in tuned.history} == {0}
    hasty = tune(limited, START, replace(enough, steps=1))
    assert {row.start for row in hasty.history} == {-1, 0, 1}


def test_a_run_ends_at_its_last_evaluation(limited, states):
    whole = states[-1].history
    for most in (1, 2, 7, len(whole) - 1):
        tuned = tune(limited, START, replace(QUICK, evaluations=most))
        count = len(tuned.history)
        assert max(1, most - 1) <= count <= most
        before_landing = tuned.history[: max(1, count - TRIES)]
        pairs = zip(before_landing, whole, strict=False)
        assert all(np.array_equal(a.z, b.z) for a, b in pairs)


def test_a_descent_that_is_cut_short_outside_ends_inside(limited):
    """From a start that asks for too much: one iteration leads near the limits, and no more."""
    start = {name: jnp.asarray(0.9) for name in START}
    hasty = replace(QUICK, starts=1, scatter=0, steps=1)
    ended = run(limited, start, hasty)
    before = next(one.descent for one in ended if one.descent is not None and one.descent.steps)
    assert before.model.excess > 1e-5
    tuned = result(limited, start, ended[-1])
    assert tuned.feasible and len(tuned.history) <= 2 + IN_ONE_STEP + TRIES
    assert same_bits(run(limited, start, hasty, save=True)[-1], ended[-1])


FEW = replace(THOROUGH, starts=1, scatter=2, spread=0.1, steps=20)


def test_an_unstable_start_is_stabilised(proportional_problem, loop_peaks, monkeypatch):
    looks = []
    monkeypatch.setattr(tuner, "loop_radii", lambda *at: looks.append(at) or loop_radii(*at))
    problem = proportional_problem(
        AtMost(peak_sensitivity=1.5), mean_tracking_error, loops=loop_peaks
    )
    states = run(problem, FAR, FEW, save=True)
    assert states[-1].looks == len(looks) > 0
    tuned = result(problem, FAR, states[-1])
    assert tuned.stabilised and tuned.feasible and tuned.diverged_starts == 0
    assert float(tuned.outcome.loops.spectral_radius.max()) < 1
    assert float(tuned.outcome.loops.sensitivity.max()) == pytest.approx(1.5, rel=1e-5)
    assert tuned.stationary
    assert same_bits(run(problem, FAR, FEW)[-1], states[-1])
    assert not tune(problem, START, FEW).stabilised


def test_a_family_without_stable_weights_tells_its_smallest_radius(
    proportional_problem, unstable_loops
):
    problem = proportional_problem(loops=unstable_loops)
    with pytest.raises(ValueError, match=r"smallest spectral radius .* is 1\.\d+, found at .*x"):
        tune(problem, FAR, FEW)


@pytest.mark.parametrize(
    ("loops", "counting"), [("counting_loops", True), ("unstable_loops", False)]
)
def test_a_mode_that_neither_decays_nor_grows_is_told(
    proportional_problem, request, loops, counting
):
    problem = proportional_problem(loops=request.getfixturevalue(loops))
    with pytest.raises(ValueError, match="spectral radius") as raised:
        tune(problem, FAR, FEW)
    assert ("every start diverges" in str(raised.value)) is not counting
    for words in ("radius 1, found at", "neither decays nor grows, as a counter in the memory"):
        assert (words in str(raised.value)) is counting


def test_prices_are_slopes_of_the_optimum_in_its_bounds(proportional_problem, loop_peaks):
    """Against optima under bounds that are a per cent apart."""

    def tuned(sensitivity, increment):
        limits = AtMost(peak_sensitivity=sensitivity, rms_increment=increment)
        return tune(
            proportional_problem(limits, typical_contour_error, loops=loop_peaks), START, CAREFUL
        )

    def objective(end):
        return np.log(float(end.outcome.metrics.rms_contour_error.max()))

    for bounds, name in (((1.3, 1.0), "peak_sensitivity"), ((10.0, 2e-5), "rms_increment")):
        here = tuned(*bounds)
        acting = name == np.array(["peak_sensitivity", "rms_increment"])
        there = tuned(*(np.array(bounds) * np.where(acting, 1.01, 1.0)))
        slope = (objective(there) - objective(here)) / np.log(1.01)
        prices = {one.name: 0.0 for one in here.prices}
        for one in here.prices:
            prices[one.name] += one.price
        assert -prices[name] == pytest.approx(slope, rel=0.03) and slope < 0
        assert sum(prices.values()) == pytest.approx(prices[name], abs=1e-6)


def test_near_and_far_points_are_scattered_to_all_sides(limited):
    effort = replace(THOROUGH, starts=2, scatter=32, spread=1.0, steps=1)
    history = tune(limited, START, effort).history
    first = [row for row in history if row.start == 0 and not row.diverged]
    centre = min(first, key=rank).z
    away = np.array([row.z - centre for row in history if row.start < 0])
    assert away.shape == (32, 2) and np.all(np.abs(away) <= 2.0)
    far = np.max(np.abs(away), axis=1) > 1.0
    assert 8 <= np.sum(far) <= 16  # a quarter of the points of the wide box lie in the narrow one
    for quadrant in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        assert np.any(far & np.all(away * quadrant > 0, axis=1))


def test_many_weights_are_scattered_as_far_as_two(limited):
    def distance(weights):
        posed = replace(limited, space=[Positive()] * weights)
        effort = replace(THOROUGH, scatter=256, spread=1.0)
        points = [
            _scattered_point(posed, [1.0] * weights, effort, TuneState(), k) for k in range(256)
        ]
        return np.sqrt(np.mean(np.sum(np.square(points), axis=1)))

    assert distance(3) == pytest.approx(distance(2), rel=0.05)


@pytest.mark.parametrize(("scatter", "with_slopes"), [(15, 15), (16, 0)])
def test_many_scattered_points_are_evaluated_without_slopes(
    limited, monkeypatch, scatter, with_slopes
):
    asked = []

    def evaluate(problem, start, z):
        asked.append(z)
        return evaluate_point(problem, start, z)

    monkeypatch.setattr("tuning.tuner.evaluate_point", evaluate)
    history = tune(limited, START, replace(THOROUGH, starts=2, scatter=scatter, steps=1)).history
    first = next(k for k, row in enumerate(history) if row.start < 0)
    scattered = history[first : first + scatter]
    assert all(row.start < 0 for row in scattered)
    descended = sum(row.start >= 0 for row in history)
    assert len(asked) == descended + with_slopes


def test_a_start_outside_the_space_is_refused(limited):
    with pytest.raises(ValueError, match="outside of Positive"):
        tune(limited, {"x": jnp.asarray(0.0), "y": jnp.asarray(0.3)}, QUICK)


def square_problem(budget):
    front, model = DATA["front"], bridgeport()
    reference = from_samples(front["yd"], front["r"], model.dt, 10, polyline(front["path"]))
    return Problem(
        lambda w: ContouringLQ(model, w, 10),
        stack_plants([model]),
        stack_references([reference]),
        mean_contour_error,
        (Positive(), Positive(), Fixed()),
        AtMost(rms_increment=budget, rms_tracking_error=100e-6),
    )


@pytest.mark.optimised
@pytest.mark.slow
@pytest.mark.parametrize(("row", "start"), [(0, (3.0, 0.1)), (1, (0.5, 20.0)), (2, (3.0, 0.1))])
def test_square_front(row, start):
    wanted = DATA["front"]["rows"][row]
    tuned = tune(square_problem(wanted["du_budget"]), LQWeights(*start, 2e-9))
    assert tuned.feasible and tuned.violation <= 1e-6
    assert 1e6 * float(tuned.outcome.metrics.rms_contour_error[0, 0]) <= 1.01 * wanted["rms_ce_um"]
    assert float(tuned.outcome.metrics.rms_increment[0, 0]) <= wanted["du_budget"] * (1 + 1e-6)


@pytest.mark.optimised
@pytest.mark.slow
def test_robust_optimum():
    """From a start decades away: within half a per cent, after at most 400 evaluations."""
    robust, model = DATA["robust"], bridgeport()
    family = [
        Delayed(with_input_gains(model, (m["gx"], m["gy"])), jnp.asarray(m["delay"]), 2, 2)
        for m in robust["family"]
    ]
    reference = along(circle(1e-3), 2.5e-5 * np.arange(753), model.dt, 10, at_rest=False)
    cap = 1e-6 * robust["rows"][0]["te_cap_um"]
    problem = Problem(
        lambda w: ContouringLQ(model, w, 10),
        stack_plants(family),
        stack_references([reference]),
        worst_contour_error,
        (Positive(), Positive(), Fixed()),
        AtMost(rms_tracking_error=cap),
        (502, 753),
    )
    tuned = tune(problem, LQWeights(0.01, 850.0, 2e-9))
    assert tuned.feasible and tuned.stationary and len(tuned.history) <= 400
    wanted = robust["rows"][0]["worst_ce_um"]
    error = 1e6 * float(tuned.outcome.metrics.rms_contour_error.max())
    assert error == pytest.approx(wanted, rel=5e-3)
    assert float(tuned.outcome.metrics.rms_tracking_error.max()) <= cap * (1 + 1e-6)


def test_history_can_be_evaluated_again(limited, states):
    row = next(row for row in states[-1].history if not row.diverged)
    again = limited.metrics(Chart(limited.space, START).weights(jnp.asarray(row.z)))
    np.testing.assert_allclose(
        again.rms_contour_error, row.outcome.metrics.rms_contour_error, rtol=1e-9
    )
