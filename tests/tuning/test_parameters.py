import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import LQWeights
from tuning.parameters import Chart, Fixed, Free, Interval, Positive

positive = st.floats(1e-8, 1e8)

SPACE = (Positive(), Positive(), Fixed())  # of alpha, beta and rho


@settings(max_examples=25)
@given(positive, positive, st.floats(0.011, 0.99), st.floats(-1e6, 1e6))
def test_round_trip(a, b, part, free):
    space = {
        "a": Positive(),
        "b": Fixed(),
        "c": Interval(1e-3, 1e3),
        "d": Interval(-2.0, 3.0),
        "e": Free(),
    }
    start = {"a": [a, b], "b": b, "c": 10 ** (6 * part - 3), "d": 5 * part - 2, "e": free}
    start = {name: np.asarray(value) for name, value in start.items()}
    chart = Chart(space, start)
    z = chart.coordinates()
    assert z.shape == (5,)
    weights = chart.weights(z)
    for name in start:
        np.testing.assert_allclose(weights[name], start[name], rtol=1e-9, atol=1e-9)
    assert weights["b"] is start["b"]


@settings(max_examples=25)
@given(st.lists(st.floats(-30, 30), min_size=3, max_size=3))
def test_no_coordinate_leaves_the_space(z):
    space = {"a": Positive(), "c": Interval(1e-3, 1e3), "d": Interval(-2.0, 3.0)}
    weights = Chart(space, dict.fromkeys(space, np.asarray(1.0))).weights(placed(np.asarray(z)))
    a, c, d = (float(weights[name]) for name in "acd")
    assert a > 0 and 1e-3 < c < 1e3 and -2 < d < 3


def test_interval_of_positive_bounds_counts_decades_alike():
    assert float(Interval(1e-4, 1e4).weight(np.zeros(()))) == pytest.approx(1.0)
    assert float(Interval(-1.0, 3.0).weight(np.zeros(()))) == pytest.approx(1.0)


def test_lq_space_leaves_rho_alone():
    start = LQWeights(3.0, 0.1, 2e-9)
    chart = Chart(SPACE, start)
    z = chart.coordinates()
    np.testing.assert_allclose(z, np.log([3.0, 0.1]))
    moved = chart.weights(placed(np.asarray(z) + 1.0))
    np.testing.assert_allclose([moved.alpha, moved.beta], np.array([3.0, 0.1]) * np.e)
    assert moved.rho is start.rho and moved.stage is None


def test_lq_space_with_a_stage_profile():
    start = LQWeights(3.0, 0.1, 2e-9, [1.0, 2.0, 0.5])
    chart = Chart((*SPACE, Positive()), start)
    assert chart.coordinates().shape == (5,)
    np.testing.assert_allclose(chart.weights(chart.coordinates()).stage, [1.0, 2.0, 0.5])


@pytest.mark.parametrize(
    ("space", "start", "words"),
    [
        ({"a": Positive()}, {"a": 0.0}, r"\['a'\].*outside of Positive"),
        ({"a": Interval(1.0, 2.0)}, {"a": 2.0}, "outside of Interval"),
        ({"a": Fixed()}, {"a": 1.0}, "nothing is left to tune"),
        ({"a": Positive()}, {"a": 1.0, "b": 1.0}, "one parameter per weight, received 1 for 2"),
        (SPACE, LQWeights(1, 1, 1, [1.0, 1.0]), "received 3 for 4"),
        ((*SPACE, Positive()), LQWeights(1, 1, 1), "received 4 for 3"),
    ],
)
def test_a_start_that_does_not_fit_is_refused(space, start, words):
    with pytest.raises(ValueError, match=words):
        Chart(space, start).coordinates()


@pytest.mark.parametrize("bounds", [(1.0, 1.0), (2.0, 1.0), (0.0, np.inf), (np.nan, 1.0)])
def test_bad_bounds_are_refused(bounds):
    with pytest.raises(ValueError, match="Interval"):
        Interval(*bounds)


def test_what_is_free_goes_as_far_as_it_likes():
    """Others go by ratios: 25 in the logarithm."""
    space = {"a": Free(), "b": Positive(), "c": Fixed(), "d": Interval(0.0, 1.0)}
    start = {"a": 1.0, "b": np.ones(2), "c": 1.0, "d": 0.5}
    assert Chart(space, start).reach().tolist() == [np.inf, 25.0, 25.0, 25.0]
