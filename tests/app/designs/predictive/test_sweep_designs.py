import pickle

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.designs.predictive.sweep_designs import PREDICTIVE, Case, PredictiveDesign
from jcontour.geometry.contours import circle
from jcontour.host.late import OneSampleLate


def case_of(controller):
    return Case(controller, machine_named("xy-table"), circle(1e-2))


def test_mpcc_runs_at_the_period_of_its_controller_and_waits_long_enough():
    """Lam's table: 4 ms on a plant of 1 ms; 0.25 m/s is 1 mm in a step of the controller."""
    made = case_of("mpcc").hosted(PredictiveDesign({"q_theta": 2.0}, 5, 250.0))
    mpcc = made.controller.controller
    assert made.controller.every == 4 and made.plant.dt == 1e-3 and mpcc.model.dt == 4e-3
    assert mpcc.weights.progress == 2.0 and mpcc.weights.contour_error == 100.0
    np.testing.assert_allclose(mpcc._upper[:5], 1.0)
    longest = made.reference.steps * made.plant.dt
    assert longest == pytest.approx(2 * np.pi * 1e-2 / (0.02 * 0.25), rel=1e-3)


def test_without_a_word_the_weights_and_the_speed_are_those_of_the_machine():
    mill = machine_named("jcontour/app/machines/example.json")
    kind, case = PREDICTIVE["mpcc"], Case("mpcc", mill, circle(1e-2))
    assert kind.speeds_mm_s(mill) == (pytest.approx(200.0),)
    made = case.hosted(PredictiveDesign({}, 5, 100.0)).controller.controller.weights
    np.testing.assert_allclose(made.control_matrix(2), 15.0 / 250.0**2 * np.eye(2))
    made = case.hosted(PredictiveDesign({"r_control": 3.0}, 5, 100.0)).controller.controller
    np.testing.assert_array_equal(made.weights.control_matrix(2), 3.0 * np.eye(2))


def test_tracking_varies_what_the_machine_can_bear():
    """15 / u_max^2, a decade to both sides; a fifth to three fifths of the slower axis' speed."""
    mill, kind = machine_named("jcontour/app/machines/example.json"), PREDICTIVE["tracking-mpc"]
    name, values = kind.varied(mill)
    assert name == "increment"
    np.testing.assert_allclose(values, 15.0 / 250.0**2 * np.array([0.1, 1.0, 10.0]))
    np.testing.assert_allclose(kind.speeds_mm_s(mill), [40.0, 60.0, 80.0, 100.0, 120.0])
    made = Case("tracking-mpc", mill, circle(1e-2)).hosted(PredictiveDesign({}, 5, 100.0))
    weights = made.controller.controller.controller.weights
    np.testing.assert_allclose(weights.increment, values[1])
    table = machine_named("xy-table")  # the paper's own
    assert kind.varied(table) == ("increment", (6.0, 60.0, 600.0))
    assert kind.speeds_mm_s(table) == (50.0, 75.0, 100.0, 125.0, 150.0)


def test_tracking_keeps_its_speed_and_the_usual_weights():
    made = case_of("tracking-mpc").hosted(PredictiveDesign({"increment": 6.0}, 5, 100.0))
    late = made.controller.controller
    assert isinstance(late, OneSampleLate) and made.controller.preview == 5 * made.controller.every
    weights = late.controller.weights
    assert (weights.output, weights.contour, weights.increment) == (1e8, 0.0, 6.0)
    arc = np.asarray(made.reference.arc)
    np.testing.assert_allclose(np.diff(arc[:100]), 0.1 * made.plant.dt)


@pytest.mark.parametrize("controller", PREDICTIVE)
def test_a_case_comes_through_another_process_unchanged(controller):
    sent = pickle.loads(pickle.dumps(case_of(controller)))
    design = PredictiveDesign({}, 4, 100.0)
    one, other = case_of(controller).hosted(design), sent.hosted(design)
    np.testing.assert_array_equal(one.reference.position, other.reference.position)
    np.testing.assert_array_equal(one.controller.preview, other.controller.preview)


@pytest.mark.parametrize(
    ("controller", "design", "says"),
    [
        ("mpcc", PredictiveDesign({"q_theta": -1.0}, 5, 100.0), "q_theta: needs to be finite"),
        ("mpcc", PredictiveDesign({}, 101, 100.0), "preview: need"),
        ("tracking-mpc", PredictiveDesign({}, 101, 100.0), "preview: needs 1 to 100 steps"),
        (
            "tracking-mpc",
            PredictiveDesign({"increment": 0.0}, 5, 100.0),
            "increment: needs to be positive",
        ),
    ],
)
def test_bad_designs_are_refused(controller, design, says):
    with pytest.raises(ValueError, match=says):
        case_of(controller).hosted(design)
