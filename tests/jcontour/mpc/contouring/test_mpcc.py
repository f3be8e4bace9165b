from functools import cache

import jax
import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.host.loop import reported_loop
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.mpc.contouring.contouring_qp import ContouringWeights
from jcontour.mpc.contouring.mpcc import MPCC, Traversal
from jcontour.plants.xy_table import FrictionXYTable, xy_table
from jcontour.qp.solvers import ProxQP
from jcontour.simulation.traversal import traversal_score
from tests.reference_data import numbers_of

DATA = numbers_of("mpcc/reference")
CASES = ("case", "case_fast")


@cache
def lobes():
    return polar_lobes(30e-3, 10e-3, 4)


@cache
def table():
    return xy_table(0.004)


# no control makes the second axis move steadily
FALLING = LinearPlant(np.eye(2), np.array([[1.0, 0.0], [0.0, 0.0]]), np.eye(2), 0.004)


def lobe_controller(q_theta=0.3, **changes):
    return MPCC(table(), lobes(), weights=ContouringWeights(progress=q_theta), **changes)


def at_start(contour, dt, steps, arc=0.0):
    return along(contour, np.full(steps, arc), dt, 0, at_rest=True)


@pytest.mark.parametrize("name", CASES)
def test_qp_and_its_optimum_are_the_reference_ones(name):
    qp, count = DATA[name]["qp"], 7
    inputs = {key: np.array(value) for key, value in qp["inputs"].items()}
    xi = np.zeros(8)
    xi[[2, 6]] = inputs["pos_mm"] / 0.7958
    theta_hat, u = np.array(qp["theta_hat_mm"]), inputs["u_prev_A"]
    plan = np.append(
        inputs["v_prev_mm"], np.diff(np.append(inputs["theta_mm"], theta_hat))[: count - 1]
    )  # whose shift gives theta_hat
    memory = Traversal(inputs["theta_mm"], plan, u, u - inputs["du_prev"], xi - inputs["dxi"], 1)
    controller = lobe_controller(DATA[name]["q_theta"])
    boxed = controller.problem(memory, xi)
    to_box = np.eye(3 * count)  # [v, u] = to_box [v, du] + shift
    to_box[count:, count:] = np.kron(np.tril(np.ones((count, count))), np.eye(2))
    shift = np.append(np.zeros(count), np.tile(u, count))
    H, g = to_box.T @ boxed.H @ to_box, to_box.T @ (boxed.g + boxed.H @ shift)
    assert (
        np.abs(H - qp["H"]).max() < 1e-9 * np.abs(qp["H"]).max()
        and np.abs(g - qp["g"]).max() < 1e-9 * np.abs(qp["g"]).max()
    )
    z = np.linalg.solve(to_box, controller.solver.solve(boxed).z - shift)
    np.testing.assert_allclose(z, qp["z"], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_closed_loop_is_the_reference_one(name):
    loop = DATA[name]["closed_loop"]
    plant = {"nominal": table(), "friction": FrictionXYTable(0.004)}[loop["plant"]]
    run = reported_loop(
        plant, lobe_controller(DATA[name]["q_theta"]), at_start(lobes(), 0.004, loop["steps"])
    )
    rollout, every = jax.device_get(run.rollout), loop["every"]
    memory = rollout.memory
    np.testing.assert_allclose(rollout.state[::every], loop["xi"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(memory.theta[::every], loop["theta_mm"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        memory.control[1::every], loop["u_A"], rtol=0, atol=1e-9
    )  # solved at k, kept for k + 1
    np.testing.assert_allclose(rollout.control[1:], memory.control[1:], rtol=0, atol=0)
    assert run.report.worst_residual < 1e-12 and run.report.active_fraction > 0.1


def test_no_constant_load_leaves_an_offset_at_the_end():
    plant = FrictionXYTable(0.004, motor_coulomb=0.0, load_coulomb=0.0, load_torque=0.03)
    contour = contours.line([0.0, 0.0], [0.02, 0.01])
    run = reported_loop(
        plant, MPCC(table(), contour, arrival=1e-15), at_start(contour, 0.004, 600)
    ).rollout
    np.testing.assert_allclose(
        np.asarray(run.output)[-1], [0.02, 0.01], rtol=0, atol=1e-9
    )  # the issue asks for 1e-3 um


CORNERED = {
    "square": lambda: contours.polygon([[0.0, 0.0], [0.03, 0.0], [0.03, 0.03], [0.0, 0.03]]),
    "zigzag": lambda: contours.polyline([[0.0, 0.0], [0.03, 0.0], [0.02, 0.01], [0.04, 0.012]]),
    "lemniscate": lambda: contours.lemniscate(0.03),
}


@pytest.mark.parametrize("name", ["zigzag", "lemniscate"])
def test_any_contour_is_traced_to_its_end(name):
    contour = CORNERED[name]()
    controller = MPCC(table(), contour)
    run = reported_loop(table(), controller, at_start(contour, 0.004, 1000)).rollout
    score = traversal_score(contour, run.output, 0.004)
    assert (
        run.output.shape[0] < 500 and score.time < 1.5 and score.rms < 30e-6 and score.peak < 200e-6
    )
    end = contour.position(contour.length)
    np.testing.assert_allclose(np.asarray(run.output)[-1], end, rtol=0, atol=2e-5)
    speed, arc = controller.speed(run.memory), controller.arc(run.memory)
    assert (
        speed.min() >= -1e-12
        and speed.max() <= 0.25 + 1e-12
        and (np.diff(arc) >= 0).all()
        and arc[-1] <= float(contour.length)
    )
    assert np.abs(run.control).max() <= 0.5 + 1e-9


def test_slows_down_at_a_corner():
    square = CORNERED["square"]()
    controller = MPCC(table(), square)
    run = reported_loop(table(), controller, at_start(square, 0.004, 1000))
    memory = run.rollout.memory
    speed, arc = controller.speed(memory), controller.arc(memory)
    assert speed[np.abs(arc - 0.03) < 0.002].min() < 0.6 * speed[np.abs(arc - 0.015) < 0.002].max()


def test_starts_where_the_reference_does_and_within_tight_limits():
    controller = MPCC(table(), lobes(), control=((-0.4, -0.3), 0.35), speed_limit=0.08, horizon=10)
    run = reported_loop(table(), controller, at_start(lobes(), 0.004, 2000, arc=0.1)).rollout
    assert (
        float(controller.arc(run.memory)[0]) == pytest.approx(0.1)
        and controller.speed(run.memory).max() <= 0.08 + 1e-12
    )
    control = np.asarray(run.control)
    assert (
        control.min(axis=0) >= np.array([-0.4, -0.3]) - 1e-12
    ).all() and control.max() <= 0.35 + 1e-12
    assert traversal_score(lobes(), run.output, 0.004, start=0.1).rms < 50e-6


def test_another_solver_and_another_unit_give_the_same_run():
    weights = ContouringWeights(
        100e6, 200e6, 0.3e3, 60.0, 200e6, length_unit=1.0
    )  # the same, per metre
    runs = [
        reported_loop(table(), c, at_start(lobes(), 0.004, 60)).rollout.output
        for c in (
            lobe_controller(),
            lobe_controller(solver=ProxQP()),
            MPCC(table(), lobes(), weights=weights),
        )
    ]
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(runs[2], runs[0], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_blocks_reach_28_ms_ahead_at_100_us():
    """20,000 steps: the industrial period that the paper names as out of reach."""
    model = xy_table(1e-4)
    controller = MPCC(model, lobes(), horizon=(1, 4, 13, 22, 31, 39, 48, 57, 65))
    assert controller.blocks.sum() == 280 and controller.blocks[0] == 1
    run = reported_loop(FrictionXYTable(1e-4), controller, at_start(lobes(), 1e-4, 40000)).rollout
    fine, coarse = traversal_score(lobes(), run.output, 1e-4), DATA["case"]["full_run"]["friction"]
    assert fine.time < 1.02 * coarse["time_s"] and 1e3 * fine.rms < coarse["rms_mm"]


def test_two_runs_of_one_controller_are_two_runs():
    """Sample by sample in turns, with different starts, as each would be alone: to the last bit."""
    controller = lobe_controller()
    references = [at_start(lobes(), 0.004, 40), at_start(lobes(), 0.004, 40, arc=0.1)]
    wanted = [reported_loop(table(), lobe_controller(), one).rollout for one in references]
    memories = [controller.initial_memory(one) for one in references]
    for k in range(40):
        for i, run in enumerate(wanted):
            state = np.asarray(run.state)[k]
            memories[i], control, _ = controller.step(memories[i], None, state)
            np.testing.assert_array_equal(control, run.control[k])
    for memory, run in zip(memories, wanted, strict=True):
        for actual, expected in zip(memory, run.final_memory, strict=True):
            np.testing.assert_array_equal(actual, expected)


def test_a_problem_belongs_to_whom_asked_for_it():
    controller, reference = lobe_controller(), at_start(lobes(), 0.004, 3)
    state = np.asarray(table().initial_state(np.asarray(reference.position)[0], np.zeros(2)))
    memory = controller.initial_memory(reference)
    first = controller.problem(memory, state)
    kept = [np.array(field) for field in first]
    after, _, _ = controller.step(memory, None, state)
    second = controller.problem(after, state)
    for field, before in zip(first, kept, strict=True):
        np.testing.assert_array_equal(field, before)
    again = controller.problem(after, state, out=first)
    assert again is first
    for field, fresh in zip(again, second, strict=True):
        np.testing.assert_array_equal(field, fresh)


def test_holding_keeps_place():
    controller, reference = lobe_controller(), at_start(lobes(), 0.004, 3)
    memory = controller.initial_memory(reference)
    state = np.asarray(table().initial_state(reference.position[0], np.zeros(2)))
    memory, first, _ = controller.step(memory, None, state)
    held = controller.held(memory, state, first)
    assert (
        held.theta == memory.theta and not held.plan.any() and held.steps == 2 and not first.any()
    )
    assert jax.tree.structure(held) == jax.tree.structure(memory)


def test_drives_that_take_a_position_are_held_where_the_run_begins():
    """y = 2 u at rest: half of the start's place acts first, and nothing moves but forward."""
    drives = LinearPlant(np.diag([0.9, 0.8]), np.diag([0.2, 0.4]), np.eye(2), 1e-3)
    path = contours.line([0.02, 0.01], [0.06, 0.04])
    mpcc, reference = MPCC(drives, path), at_start(path, 1e-3, 3)
    memory = mpcc.initial_memory(reference)
    state = np.asarray(drives.initial_state(reference.position[0], np.zeros(2)))
    after, acting, _ = mpcc.step(memory, None, state)
    np.testing.assert_allclose(acting, [0.01, 0.005], rtol=1e-12)
    np.testing.assert_allclose(drives.step(state, acting), [0.02, 0.01], rtol=1e-12)
    assert (after.control > acting).all()


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: lobe_controller(control=(0.6, 0.5)), "control"),
        (lambda: lobe_controller(control=((1.0, 2.0, 3.0), 4.0)), "control"),
        (lambda: lobe_controller(speed_limit=0.0), "speed_limit"),
        (lambda: lobe_controller(horizon=0), "horizon"),
        (lambda: lobe_controller(arrival=-1.0), "arrival"),
        (lambda: MPCC(table(), contours.line([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])), "axes"),
        (lambda: MPCC(table(), contours.stack([lobes(), lobes()])), "stack"),
        (lambda: lobe_controller().initial_memory(at_start(lobes(), 0.001, 5)), "dt"),
        (
            lambda: lobe_controller().initial_memory(
                at_start(contours.line([0.0, 0.0, 0.0], [0.1, 0.0, 0.0]), 0.004, 5)
            ),
            "^reference: needs as many axes as the model has outputs, 2, received 3",
        ),
        (lambda: MPCC(FALLING, lobes()).initial_memory(at_start(lobes(), 0.001, 5)), "^dt"),
        (
            lambda: lobe_controller().initial_memory(
                at_start(polar_lobes(0.04, 0.01, 4), 0.004, 5)
            ),
            "long",
        ),
        (
            lambda: lobe_controller().initial_memory(at_start(lobes(), 0.004, 5, arc=0.3)),
            "start on the path",
        ),
        (
            lambda: lobe_controller(control=(0.1, 0.5)).initial_memory(at_start(lobes(), 0.004, 5)),
            "held at the start by",
        ),
    ],
)
def test_bad_input_is_one_line(make, words):
    with pytest.raises(ValueError, match=words):
        make()
