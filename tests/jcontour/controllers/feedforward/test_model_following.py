"""Model following against Table 1 of Alter & Tsao and the controllers of an explicit loop."""

import warnings

import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from jcontour.controllers.feedforward.l1 import l1_optimum
from jcontour.controllers.feedforward.model_following import (
    ModelFollowing,
    divided,
    optimal_feedforward,
    parallel_feedforward,
    shortest_error,
)
from jcontour.controllers.feedforward.model_matching import hinf_optimum
from jcontour.linear.transfer_functions import from_polynomials, transfer_function
from jcontour.plants.linear_machines import linear_motor_drive

DT = 5e-4


@pytest.fixture(scope="module", params=["b_fitted", "b_printed"])
def rows(request, alter_tsao):
    actual = []
    for line in alter_tsao["table1"]:
        row = line[request.param]
        actual.append((ModelFollowing(row["m"], row["Np"], row["N"]), row, line["line"]))
    return actual


def padded(taps, count=12):
    return np.concatenate([taps, np.zeros(count - len(taps))])


def test_table_1(rows):
    for following, wanted, line in rows:
        problem = following.matching(np.array([0.0, wanted["b"]]))
        optimum = l1_optimum(problem)
        assert optimum.cost == pytest.approx(wanted["J_l1"], rel=1e-8), line
        assert abs(optimum.gap) < 1e-9
        assert hinf_optimum(problem).cost == pytest.approx(wanted["J_hinf"], rel=1e-8), line
        taps = shortest_error(problem)
        np.testing.assert_allclose(taps, wanted["E_prime"], rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(
            padded(optimum.taps), padded(wanted["E_prime"]), rtol=1e-8, atol=1e-12
        )
        error, below = following.error(optimum)
        tracking, _ = following.tracking_error(optimum)
        np.testing.assert_allclose(below, [1.0])
        np.testing.assert_allclose(padded(error), padded(wanted["E_model"]), rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(
            padded(tracking), padded(wanted["E_track"]), rtol=1e-8, atol=1e-12
        )


def test_bandwidth_of_the_model(alter_tsao):
    for order, wanted in alter_tsao["m_bandwidth_hz"].items():
        actual = ModelFollowing(int(order), int(order)).bandwidth(DT)
        assert actual == pytest.approx(wanted, rel=1e-8)
    assert ModelFollowing().bandwidth(DT) == np.inf


@pytest.mark.parametrize("optimum", [l1_optimum, hinf_optimum])
@pytest.mark.parametrize("numbers", [(0, 2, 0), (0, 3, 2), (1, 3, 1)])
def test_the_filter_inverts_the_plant(optimum, numbers):
    """P F = W sample by sample, on a plant with two unstable zeros and one that cancels."""
    top = np.concatenate([[0.0], polynomial.polyfromroots([-0.4, 0.7, -2.5])])
    plant = from_polynomials(0.1 * top, polynomial.polyfromroots([1.3, 1.8, 2.5, 3.0]) / 10, DT)
    actual = optimal_feedforward(plant, ModelFollowing(*numbers), optimum)
    pulse = np.eye(1, 200)[0]
    control = lfilter(actual.numerator, actual.denominator, pulse)
    output = lfilter(plant.numerator, plant.denominator, control)
    np.testing.assert_allclose(output, lfilter(*actual.wanted, pulse), atol=1e-9)
    assert np.all(np.abs(np.roots(actual.denominator[::-1])) > 1)


def test_the_paper_s_controllers_in_a_loop(alter_tsao):
    loop = alter_tsao["explicit_loop"]
    plant = transfer_function(linear_motor_drive())
    for run in loop["runs"]:
        controller = loop[run["controller"]]
        following = ModelFollowing(run["m"], run["Np"], run["N"])
        taps = shortest_error(following.matching(np.array([0.0, -0.3075])))
        wanted = polynomial.polysub(following.response, np.convolve(following.weight, taps))
        shared = (-1.0, 1.0) if run["controller"].startswith("B") else (1.0,)
        feedback = np.array(controller["num_lambda"]), np.array(controller["den_lambda"])
        actual = parallel_feedforward(plant, feedback, wanted, shared)
        for ours, theirs in zip(actual, (run["cff_num"], run["cff_den"]), strict=True):
            ours = ours[: len(theirs)]
            np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.max(np.abs(theirs)))


def test_without_unstable_zeros_it_is_the_plain_inverse():
    inverse = optimal_feedforward(
        from_polynomials([0.0, 1.0, 0.5], [1.0, -0.9], DT), ModelFollowing(preview=1)
    )
    assert inverse.optimum.cost == 0


def test_a_preview_shorter_than_the_delay_is_warned_of():
    plant = from_polynomials([0.0, 0.0, 0.4, 1.0], [1.0, -0.9], DT)
    with pytest.warns(UserWarning, match="1 samples are shorter than the plant's delay of 2"):
        late = optimal_feedforward(plant, ModelFollowing(preview=1))
    top, below = late.optimum.numerator, late.optimum.denominator
    assert top[1] / below[0] == 1  # the error is the whole reference, at the sample it is seen
    with warnings.catch_warnings(action="error"):
        optimal_feedforward(plant, ModelFollowing(preview=2))


def test_bad_input():
    on_circle = from_polynomials([0.0, 1.0, 1.0], [1.0, -0.9], DT)
    with pytest.raises(ValueError, match="on the unit circle"):
        optimal_feedforward(on_circle, ModelFollowing(preview=2))
    with pytest.raises(ValueError, match="looks 2 samples ahead, received 1"):
        ModelFollowing(order=2, preview=1)
    with pytest.raises(ValueError, match="constraint: needs a whole number"):
        ModelFollowing(constraint=-1)
    with pytest.raises(ValueError, match="leaves a remainder"):
        divided([1.0, 1.0], [1.0, 2.0])
