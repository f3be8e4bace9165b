"""The condensed QP against the cost (15) written out sample by sample.

Models, paths and blocks are such as the reference data do not have.
"""

import jax
import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.linear.plant import LinearPlant
from jcontour.mpc.contouring.contouring_qp import ContouringWeights, path_of
from jcontour.mpc.contouring.mpcc import MPCC, Traversal
from jcontour.plants.xy_table import xy_table

W = ContouringWeights(70.0, 150.0, 0.4, np.array([50.0, 80.0]), 90.0, length_unit=1e-3, period=4e-3)
W3 = ContouringWeights(
    70.0, 150.0, 0.4, np.diag([50.0, 80.0, 20.0]) + 3.0, 90.0, length_unit=1e-2, period=3e-3
)


def three_axes():
    rng = np.random.default_rng(1)
    A = np.eye(5) + 0.05 * rng.normal(size=(5, 5))
    return LinearPlant(A, 0.1 * rng.normal(size=(5, 3)), 0.1 * rng.normal(size=(3, 5)), 2e-3)


def samples():
    return xy_table(0.004), polar_lobes(30e-3, 10e-3, 3, 0.4), W, 5


def blocks():
    corner = contours.polygon([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01]])
    return xy_table(0.001), corner, W, (1, 2, 5)


def helix():
    path = contours.arc([0.02, 0.0, 0.0], [0.0, 0.0, 0.0], 7.0, rise=0.01)
    return three_axes(), path, W3, (2, 1, 3)


@jax.jit
def jet(contour, arc):
    """Place on the contour and its derivatives with respect to arc length."""
    piece, s, _ = contour._at(arc)
    return piece.jet(s)


def cost(controller, memory, measurement, v, u):
    """J of the speeds (B,) and controls (B, p), by stepping the delayed plant sample by sample.

    The present disturbance is held.
    """
    model, w, contour = controller.model, controller.weights, controller.contour
    A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
    unit, h, length = w.length_unit, model.dt, float(contour.length)
    R = w.control_matrix(model.inputs)
    dx, y, acting, before = (
        measurement - memory.state,
        C @ measurement,
        memory.control,
        memory.before,
    )
    theta, guess, total = float(memory.theta), float(memory.theta), 0.0
    old = np.repeat(memory.plan, controller.blocks)
    sample = 0
    for b, block in enumerate(controller.blocks):
        dv, du = (
            v[b] - (v[b - 1] if b else memory.plan[0]),
            u[b] - (u[b - 1] if b else memory.control),
        )
        gap = ((block + controller.blocks[b - 1]) / 2 if b else (1 + block) / 2) * h / w.period
        total += (du @ R @ du + w.speed_change * dv**2) / gap
        for _ in range(block):
            dx = A @ dx + B @ (acting - before)
            y = y + C @ dx
            before, acting = acting, u[b]
            theta += v[b] * h / w.period
            total -= w.progress * theta * h / w.period
            guess += old[min(sample + 1, old.size - 1)] * h / w.period
            sample += 1
        guess_now = min(guess, 0.0)
        arc = min(
            guess_now * unit + length, np.nextafter(length, 0)
        )  # the end itself wraps on a closed contour
        point, slope, _ = jax.device_get(jet(contour, arc))  # slope is dp/darc, not normalised
        tangent = slope / np.linalg.norm(slope)
        error = (y - point) / unit - slope * (theta - guess_now)
        lag = tangent @ error
        share = block * h / w.period
        total += share * (w.contour_error * (error @ error - lag**2) + w.lag * lag**2)
    return total


@pytest.mark.parametrize("make", [samples, blocks, helix])
def test_the_qp_is_the_cost_up_to_a_constant(make):
    model, contour, weights, horizon = make()
    controller = MPCC(model, contour, weights=weights, horizon=horizon)
    rng = np.random.default_rng(2)
    n, p, count = model.states, model.inputs, len(controller.blocks)
    for start in (0.3, 0.9999):  # in the middle, and where the estimates meet the end
        memory = Traversal(
            np.array((start - 1) * controller.length),
            rng.uniform(0, 0.5, count),
            *rng.normal(size=(2, p)),
            np.zeros(n),
            3,
        )
        x = rng.normal(size=n)
        memory = memory._replace(state=x + 0.1 * rng.normal(size=n))
        qp = controller.problem(memory, x)
        np.testing.assert_array_equal(qp.H, qp.H.T)
        assert qp.upper_rows[0] == -memory.theta and np.linalg.eigvalsh(qp.H).min() > 0
        travel = np.append(controller.blocks * model.dt / weights.period, np.zeros(count * p))
        np.testing.assert_allclose(qp.C[0], travel, rtol=1e-15)
        z = rng.normal(size=(9, count * (1 + p)))
        values = np.array(
            [cost(controller, memory, x, row[:count], row[count:].reshape(count, p)) for row in z]
        )
        quadratic = 0.5 * np.einsum("ki,ij,kj->k", z, qp.H, z) + z @ qp.g
        np.testing.assert_allclose(
            np.diff(values), np.diff(quadratic), rtol=1e-9, atol=1e-9 * np.abs(values).max()
        )


@pytest.mark.parametrize("given", [60.0, (60.0, 60.0), [[60.0, 0.0], [0.0, 60.0]]])
def test_one_number_stands_for_all_inputs(given):
    matrix = ContouringWeights(control_change=given).control_matrix(2)
    np.testing.assert_array_equal(matrix, 60.0 * np.eye(2))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("contour_error", -1.0),
        ("progress", float("nan")),
        ("lag", float("inf")),
        ("speed_change", 0.0),
        ("length_unit", 0.0),
        ("period", -1.0),
    ],
)
def test_bad_weights(field, value):
    with pytest.raises(ValueError, match=f"^{field}: needs to be finite"):
        ContouringWeights(**{field: value})


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], "positive semidefinite"),
        (0.0, "positive definite"),
        ((1.0, 2.0, 3.0), "one for each of 2 inputs"),
        (np.eye(3), "needs shape"),
    ],
)
def test_bad_control_matrices(given, says):
    with pytest.raises(ValueError, match=f"^control_change: .*{says}"):
        ContouringWeights(control_change=given).control_matrix(2)


PATHS = {
    "lobes": polar_lobes(30e-3, 10e-3, 4),
    "square": contours.polygon([[0.0, 0.0], [0.03, 0.0], [0.03, 0.03], [0.0, 0.03]]),
    "rounded": contours.chain(
        [contours.line([0.0, 0.0], [0.02, 0.0]), contours.arc([0.02, 0.0], [0.02, 0.01], np.pi)]
    ),
    "helix": contours.arc([0.02, 0.0, 0.0], [0.0, 0.0, 0.0], 7.0, rise=0.01),
    "lemniscate": contours.lemniscate(0.03),
}


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("unit", (1.0, 1e-3))
def test_is_the_contour_in_another_unit(name, unit):
    contour = PATHS[name]
    path = path_of(contour, unit)
    assert (
        path.length * unit == pytest.approx(float(contour.length), rel=1e-14)
        and path.axes == contour.axes
    )
    for arc in np.linspace(0.0, path.length, 101):
        position, slope = path.at(arc)
        inside = min(
            arc * unit, np.nextafter(float(contour.length), 0)
        )  # the end itself wraps on a closed contour
        np.testing.assert_allclose(position * unit, contour.position(inside), rtol=0, atol=1e-13)
        if np.abs(np.asarray(contour.start) - inside).min() > 1e-9:
            np.testing.assert_allclose(
                slope / np.linalg.norm(slope), contour.tangent(inside), rtol=0, atol=1e-9
            )


def test_slope_is_the_derivative():
    path = path_of(PATHS["rounded"], 1e-3)
    for arc in (3.3, 25.0, 40.0):
        forward, backward = path.at(arc + 1e-4)[0], path.at(arc - 1e-4)[0]
        np.testing.assert_allclose(path.at(arc)[1], (forward - backward) / 2e-4, rtol=0, atol=1e-8)


def test_padding_does_not_count():
    padded = contours.stack([PATHS["square"], PATHS["rounded"]])
    alone = jax.tree.map(lambda rows: np.asarray(rows)[1], padded)
    assert path_of(alone, 1.0).rate.size == 2


@pytest.mark.parametrize(
    "contour, unit, words", [("square", 0.0, "length_unit"), ("square", np.nan, "length_unit")]
)
def test_bad_input_is_one_line(contour, unit, words):
    with pytest.raises(ValueError, match=words):
        path_of(PATHS[contour], unit)
