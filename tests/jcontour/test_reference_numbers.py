"""The library against numbers computed by other code.

See tests/data/mcnab/README.md for their definitions.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
    contour_weight,
    control_weight,
)
from jcontour.controllers.observers.kalman import FilterObserver, PredictorObserver
from jcontour.geometry.contours import circle, polyline
from jcontour.linear.plant import LinearPlant, SteadyMotion, spectral_radius, steady_motion
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.references import along, from_samples
from jcontour.plants.actuation import Delayed, Disturbed
from jcontour.plants.encoders import Encoders
from jcontour.plants.linear_machines import bridgeport
from jcontour.riccati.receding_horizon import CostToGo, one_stage_back
from jcontour.simulation.closed_loop import prepared, simulate
from jcontour.simulation.evaluation import evaluate, member, stack_plants, stack_references
from jcontour.simulation.metrics import score
from tests.reference_data import numbers_of

DT, RADIUS, ANGLE = 0.5e-3, 1e-3, 0.025  # s, m, rad per sample
TERMINALS = {"output": OutputTerminal(), "dare": RiccatiTerminal()}


CASES = {case["name"]: case for case in numbers_of("mcnab/cases")}
SLOW_CASES = {
    "helix3_output",
    "helix3_dare",
    "circle_Np1_output",
    "circle_Np40_dare",
}  # each compiles for itself
UM = {
    "te": ("rms_tracking_error", 1e6),
    "pce": ("rms_projected_error", 1e6),
    "ce": ("rms_contour_error", 1e6),
}
COLUMNS = {**UM, "u": ("rms_control", 1.0), "du": ("rms_increment", 1.0)}


def relative(actual, wanted):
    wanted = np.asarray(wanted, float)
    return np.max(np.abs(np.asarray(actual) - wanted)) / np.max(np.abs(wanted))


def weights_of(row):
    return LQWeights(row["alpha"], row["beta"], row["rho"])


def plant_of(name):
    return LinearPlant(*(numbers_of("mcnab/plants")[name][part] for part in "ABC"), DT)


def terminal_of(inputs):
    if inputs["terminal"] == "output":
        return OutputTerminal()
    return RiccatiTerminal(
        SteadyMotion(placed(np.array(inputs["Sy"])), placed(np.array(inputs["Sv"])))
    )


def reference_of(inputs):
    contour = (
        circle(inputs["circle_radius"]) if "circle_radius" in inputs else polyline(inputs["path"])
    )
    return from_samples(inputs["yd"], inputs["r"], DT, inputs["Np"], contour)


@pytest.fixture(scope="module")
def references():
    """References of all cases.

    Those of the same shape are padded alike, so that they share what is compiled.
    """
    single = {name: reference_of(case["inputs"]) for name, case in CASES.items()}
    alike = [name for name in single if name not in SLOW_CASES]
    stacked = jax.device_get(stack_references([single[name] for name in alike]))
    return {**single, **{name: member(stacked, i) for i, name in enumerate(alike)}}


def cost_of_first_step(model, weights, terminal, reference, preview):
    """H_1 at step 0."""
    Q, R = (
        contour_weight(weights.alpha, weights.beta, reference.tangent),
        control_weight(model, weights),
    )
    ends = slice(preview, preview + 1)
    cost = terminal.cost(model, weights, Q, reference.position, ends)
    for j in range(preview - 1, 0, -1):
        cost = one_stage_back(
            model, R, CostToGo(*cost), Q[j : j + 1], reference.position[j : j + 1]
        )
    return cost.H[0]


@eqx.filter_jit
def all_of(plant, controller, reference, state, window):
    rollout, plan = simulate(plant, controller, reference, state), prepared(controller, reference)
    metrics = score(rollout, reference, window)
    H_1 = cost_of_first_step(
        plant, controller.weights, controller.terminal, reference, controller.preview
    )
    H_s = (
        controller.terminal.solution(plant, controller.weights)
        if isinstance(controller.terminal, RiccatiTerminal)
        else None
    )
    actual = {
        "y": rollout.output,
        "u": rollout.control,
        "x_end": rollout.final_state,
        "F0": plan.F[0],
        "f0": plan.f[0],
        "F_last": plan.F[-1],
        "H1_first": H_1,
        "H_s": H_s,
        "rms_te": metrics.rms_tracking_error,
        "rms_pce": metrics.rms_projected_error,
        "rms_ce": metrics.rms_contour_error,
        "max_ce": metrics.peak_contour_error,
        "rms_u": metrics.rms_control,
        "rms_du": metrics.rms_increment,
    }
    return {key: value for key, value in actual.items() if value is not None}, metrics.diverged


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW_CASES)) for name in CASES]
)
def test_cases(name, references):
    inputs, outputs = CASES[name]["inputs"], CASES[name]["outputs"]
    plant = plant_of(inputs["plant"])
    controller = ContouringLQ(plant, weights_of(inputs), inputs["Np"], terminal_of(inputs))
    actual, diverged = all_of(
        plant, controller, references[name], jnp.asarray(inputs["x0"]), tuple(inputs["window"])
    )
    assert set(actual) == set(outputs)
    assert not diverged
    assert not {
        key: off for key, value in actual.items() if (off := relative(value, outputs[key])) > 1e-8
    }
    loops = np.asarray(plant.A) - np.asarray(plant.B) @ np.stack([actual["F0"], actual["F_last"]])
    assert relative(spectral_radius(loops), CASES[name]["frozen_spectral_radius_first_last"]) < 1e-8


@pytest.mark.parametrize("name", ["circle_III", "helix3_dare"])
def test_steady_motion_of_cases(name):
    inputs = CASES[name]["inputs"]
    motion = eqx.filter_jit(steady_motion)(plant_of(inputs["plant"]))
    assert relative(motion.Sy, inputs["Sy"]) < 1e-8
    assert relative(motion.Sv, inputs["Sv"]) < 1e-8
    if name.startswith("circle"):  # the others start at rest
        start, following = np.array(inputs["yd"][:2])
        assert relative(motion.state(start, following - start), inputs["x0"]) < 1e-8


def circle_reference(steps, preview):
    return along(circle(RADIUS), ANGLE * RADIUS * np.arange(steps), DT, preview, at_rest=False)


@eqx.filter_jit
def on_family(machines, model, terminal, preview, weights, reference, window):
    controller = ContouringLQ(model, weights, preview, terminal)
    batch = jax.tree.map(lambda leaf: leaf[None] if eqx.is_array(leaf) else leaf, reference)
    return jax.tree.map(lambda leaf: leaf[0], evaluate(machines, controller, batch, window))


def machine(gain_x=1.0, gain_y=1.0, delay=0):
    plant = with_input_gains(bridgeport(), (gain_x, gain_y))
    return Delayed(plant, jnp.asarray(delay), 2, plant.inputs)


@pytest.fixture(scope="module")
def family():
    """The five machines of tuning.json, the nominal one first."""
    members = numbers_of("mcnab/tuning")["robust"]["family"]
    assert members[0] == {"delay": 0, "gx": 1, "gy": 1}
    return stack_plants([machine(m["gx"], m["gy"], m["delay"]) for m in members])


def check_row(row, metrics):
    """All columns of a row of a table; one table has no projected error."""
    assert set(COLUMNS) - set(row) <= {"pce"}
    for column, (name, factor) in COLUMNS.items():
        if column in row:
            actual = float(np.ravel(getattr(metrics, name))[0]) * factor
            assert actual == pytest.approx(row[column], rel=1e-6), (row["alpha"], column)


def check_rows(rows, family, reference):
    """Rows of a table, on the last turn of the circle."""
    model = bridgeport()
    for row in rows:
        terminal, weights = TERMINALS[row["terminal"]], weights_of(row)
        arguments = family, model, terminal, row["Np"], weights, reference, (502, 753)
        check_row(row, on_family(*arguments))


@pytest.mark.parametrize("terminal", ["dare", pytest.param("output", marks=pytest.mark.slow)])
def test_circle_grid(terminal, family):
    reference = circle_reference(753, 10)
    rows = [row for row in numbers_of("mcnab/circle_grid") if row["terminal"] == terminal]
    assert len(rows) == 30
    check_rows(rows, family, reference)


def test_robust_optimum(family):
    problem, reference = numbers_of("mcnab/tuning")["robust"], circle_reference(753, 10)
    row = problem["rows"][0]
    metrics = on_family(
        family, bridgeport(), OutputTerminal(), 10, weights_of(row), reference, (502, 753)
    )
    assert 1e6 * float(metrics.rms_contour_error.max()) == pytest.approx(
        row["worst_ce_um"], rel=1e-6
    )
    assert 1e6 * float(metrics.rms_tracking_error.max()) == pytest.approx(
        row["worst_te_um"], rel=1e-6
    )


@pytest.mark.slow
def test_front_on_the_square():
    problem, plant = numbers_of("mcnab/tuning")["front"], bridgeport()
    reference = from_samples(problem["yd"], problem["r"], DT, 10, polyline(problem["path"]))
    assert reference.steps == 400

    def on_square(row):
        rollout = simulate(
            plant, ContouringLQ(plant, weights_of(row), 10), reference, jnp.asarray(problem["x0"])
        )
        return score(rollout, reference)

    names = {"ce": "rms_ce_um", "te": "rms_te_um", "u": "rms_u", "du": "rms_du"}
    rows = [{column: row[name] for column, name in names.items()} | row for row in problem["rows"]]
    for row in (problem["baseline"], *rows):
        metrics = on_square(row)
        check_row(row, metrics)
        largest = row.get("ce_max", row.get("max_ce_um"))
        assert 1e6 * float(metrics.peak_contour_error) == pytest.approx(largest, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("terminal", "preview"), [("output", 1), ("output", 30), ("dare", 5)])
def test_circle_preview_scan(terminal, preview, family):
    reference = circle_reference(753, preview)
    scan = numbers_of("mcnab/circle_np_scan")
    rows = [row for row in scan if (row["terminal"], row["Np"]) == (terminal, preview)]
    assert len(rows) == 2
    check_rows(rows, family, reference)


@pytest.mark.parametrize("terminal", ["output", pytest.param("dare", marks=pytest.mark.slow)])
def test_circle_gradients(terminal):
    rows = [row for row in numbers_of("mcnab/circle_gradients") if row["terminal"] == terminal]
    assert len(rows) == 3
    plant = bridgeport()
    reference = circle_reference(rows[0]["K"], 10)

    def losses(logarithms):
        controller = ContouringLQ(plant, LQWeights(*jnp.exp(logarithms)), 10, TERMINALS[terminal])
        metrics = score(simulate(plant, controller, reference), reference, tuple(rows[0]["window"]))
        true, projected, tracking = (
            1e6 * getattr(metrics, name) for name, _ in (UM["ce"], UM["pce"], UM["te"])
        )
        rest = 0.05 * tracking**2 + 1e-2 * metrics.rms_control**2
        values = jnp.stack([jnp.log(true), jnp.log(projected), true**2 + rest, projected**2 + rest])
        return values, values

    slopes = jax.jit(jax.jacrev(losses, has_aux=True))
    for row in rows:
        assert (row["K"], row["window"], row["Np"]) == (rows[0]["K"], rows[0]["window"], 10)
        gradient, values = slopes(jnp.log(jnp.array([row["alpha"], row["beta"], row["rho"]])))
        np.testing.assert_allclose(values, row["value"], rtol=1e-9)
        np.testing.assert_allclose(gradient, row["complex_step"], rtol=1e-7)
        assert np.max(np.abs(np.sum(gradient, axis=1))) < 1e-9


@pytest.mark.parametrize("name", ["observer_filter", "observer_predictor"])
def test_observer_cases(name):
    case = next(case for case in numbers_of("mcnab/observer_cases") if case["name"] == name)
    inputs, outputs = case["inputs"], case["outputs"]
    plant = plant_of(inputs["plant"])
    reference = from_samples(inputs["yd"], inputs["r"], DT, inputs["Np"])
    kind = {"filter": FilterObserver, "predictor": PredictorObserver}[inputs["form"]]
    law = ContouringLQ(plant, weights_of(inputs), inputs["Np"], TERMINALS[inputs["terminal"]])
    controller = kind(law, plant, jnp.asarray(outputs["L"]), jnp.asarray(inputs["xhat0"]))
    noisy = Disturbed(Encoders(plant), noise=jnp.asarray(inputs["v"]))
    rollout = simulate(
        noisy, controller, reference, (jnp.asarray(inputs["x0"]), jnp.zeros((), int))
    )
    assert relative(rollout.output, outputs["y"]) < 1e-8
    assert relative(rollout.control, outputs["u"]) < 1e-8
