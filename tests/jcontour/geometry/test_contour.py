"""Contours against curves in NumPy: dense search refined by SciPy, closed-form lengths."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jcontour.geometry import contours
from jcontour.geometry.contour import outline
from jcontour.geometry.contours import (
    stack,
)

CLOSED = {"polygon", "square", "circle", "clockwise", "ellipse", "lemniscate", "periodic", "slot"}
NAMES = sorted(
    CLOSED
    | {"line", "polyline", "turns", "arc", "spline", "spline 3-D", "polyline 3-D", "arc 3-D"}
    | {"helix", "chain 3-D"}
)


def test_all_cases_are_asked(shapes):
    assert set(NAMES) == set(shapes.cases())


@pytest.mark.parametrize("name", NAMES)
def test_positions_lie_on_the_curve_from_end_to_end(name, shapes):
    contour, curve, length = shapes.cases()[name]
    total = float(contour.length)
    assert bool(contour.closed) == (name in CLOSED)
    if length is not None:
        assert total == pytest.approx(length, rel=1e-12)
    position = shapes.along(contour.position, np.linspace(0, total, 40))
    np.testing.assert_allclose(position[[0, -1]], curve(np.array([0.0, 1.0])), atol=2e-15)
    assert (
        max(shapes.brute_distance(curve, point) for point in position)
        <= float(contour.fit_error) + 1e-13
    )
    box = curve(np.linspace(0, 1, 20001))
    assert float(contour.size) == pytest.approx(np.linalg.norm(np.ptp(box, axis=0)), rel=1e-4)


@pytest.mark.parametrize("name", ["polyline", "helix", "spline"])
def test_places_in_numpy_are_the_positions(name, shapes):
    contour = shapes.cases()[name][0]
    mask = np.asarray(contour.mask)
    pieces = jax.tree.map(lambda rows: np.asarray(rows)[mask], contour.pieces)
    middle = 0.5 * pieces.extent
    expected = shapes.along(contour.position, pieces.start + middle)
    np.testing.assert_allclose(pieces.jet(middle)[0], expected, atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_tangent_and_curvature_are_the_derivatives(name, shapes):
    contour = shapes.cases()[name].contour
    total, h = float(contour.length), 1e-5
    s = np.random.default_rng(0).uniform(2 * h, total - 2 * h, 300)
    s = s[np.min(np.abs(s[:, None] - np.asarray(contour.start)), axis=1) > 2 * h]  # off the corners
    stencil = shapes.along(contour.position, s[:, None] + h * np.array([-2, -1, 0, 1, 2]))
    velocity = np.einsum("i,sim->sm", np.array([1, -8, 0, 8, -1]) / (12 * h), stencil)
    acceleration = np.einsum("i,sim->sm", np.array([-1, 16, -30, 16, -1]) / (12 * h**2), stencil)
    tangent = shapes.along(contour.tangent, s)
    np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(tangent, velocity, atol=2e-7)
    np.testing.assert_allclose(
        shapes.along(contour.curvature, s),
        np.linalg.norm(acceleration, axis=1),
        atol=2e-4,
        rtol=1e-4,
    )
    np.testing.assert_allclose(
        shapes.along(contour.curvature_vector, s), acceleration, atol=2e-3
    )  # fits are not quite in arc length


@pytest.mark.parametrize("name", NAMES)
def test_nearest_anywhere_is_the_nearest_point_of_the_true_curve(name, shapes):
    contour, curve, _ = shapes.cases()[name]
    point = shapes.points_around(shapes.cases()[name], 40, seed=1)
    actual = shapes.distance(contour, point, shapes.nearest_anywhere(contour, point))
    expected = np.array([shapes.brute_distance(curve, y) for y in point])
    np.testing.assert_allclose(actual, expected, atol=float(contour.fit_error) + 2e-12)
    for y, least in zip(
        point[::10], actual[::10], strict=True
    ):  # SciPy finds no nearer point either
        start = np.argmin(np.linalg.norm(curve(np.linspace(0, 1, 31)) - y, axis=1)) / 30
        result = minimize(
            lambda u, y=y: 1e4 * np.sum((curve(u[0]) - y) ** 2),
            [start],
            bounds=[(0, 1)],
            method="Nelder-Mead",
        )
        assert least <= np.sqrt(result.fun / 1e4) + float(contour.fit_error) + 1e-12


@pytest.mark.parametrize("name", NAMES)
def test_nearest_is_the_nearest_point_within_reach(name, shapes):
    contour = shapes.cases()[name].contour
    total, rng = float(contour.length), np.random.default_rng(2)
    point = shapes.points_around(shapes.cases()[name], 400, seed=3)
    at = rng.uniform(-0.2 * total, 1.2 * total, 400)
    reach = total * 10.0 ** rng.uniform(-4, 0.2, 400)
    actual = shapes.nearest(contour, point, at, reach)
    if bool(contour.closed):
        away = np.abs((actual - at + total / 2) % total - total / 2)
        window = at[:, None] + np.minimum(reach, total / 2)[:, None] * np.linspace(-1, 1, 401)
    else:
        away = np.abs(actual - np.clip(at, 0, total))
        window = np.clip(
            np.clip(at, 0, total)[:, None] + reach[:, None] * np.linspace(-1, 1, 401), 0, total
        )
    assert np.all((actual >= 0) & (actual <= total)) and np.all(away <= reach + 1e-14)
    least = shapes.distance(contour, point, actual)
    assert np.all(least <= shapes.distance(contour, point[:, None], window).min(axis=1) + 1e-11)
    wide = np.flatnonzero(reach >= total)[:40]
    np.testing.assert_allclose(
        least[wide],
        shapes.distance(contour, point[wide], shapes.nearest_anywhere(contour, point[wide])),
        atol=1e-11,
    )


def test_open_contours_go_straight_on(shapes):
    contour = shapes.cases()["arc"].contour
    total = float(contour.length)
    start, end = shapes.along(contour.tangent, (0.0, total))
    np.testing.assert_allclose(
        shapes.along(contour.position, (-0.02, total + 0.02)),
        shapes.along(contour.position, (0, total)) + [-0.02 * start, 0.02 * end],
    )
    np.testing.assert_array_equal(shapes.along(contour.tangent, (-1.0, total + 1.0)), [start, end])
    np.testing.assert_allclose(
        shapes.along(contour.curvature, (-0.01, total + 0.01, 0.0, total)),
        (0, 0, 1 / 0.03, 1 / 0.03),
    )


@pytest.mark.parametrize("name", sorted(CLOSED))
def test_closed_contours_wrap(name, shapes):
    contour = shapes.cases()[name].contour
    total = float(contour.length)
    s = np.linspace(0, total, 20, endpoint=False) + 1e-4
    np.testing.assert_allclose(
        shapes.along(contour.position, s - 2 * total), shapes.along(contour.position, s), atol=1e-14
    )
    np.testing.assert_allclose(
        shapes.along(contour.tangent, s + total), shapes.along(contour.tangent, s), atol=1e-11
    )


def test_the_lap_before_the_start_is_shorter_than_rounding(shapes):
    """A place just before the start is within [0, length), though length - 1e-20 is length."""
    circle = shapes.cases()["circle"][0]
    length = float(circle.length)
    within = np.asarray(jax.jit(lambda arc: circle.within(arc))(np.array([-1e-20, length, -1e-9])))
    assert within[0] == within[1] == 0.0 and 0 < within[2] < length


def test_corners_are_exact_and_belong_to_the_piece_that_begins_there(shapes):
    square, corners, outward = (
        shapes.cases()["square"].contour,
        shapes.SQUARE,
        np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]),
    )
    at = np.array([0.0, 0.125, 0.25, 0.375])
    point = corners + 1e-3 * outward
    for actual in (
        shapes.nearest(square, point, at + 0.003, 0.01),
        shapes.nearest(square, point, at - 0.003, 0.01),
        shapes.nearest_anywhere(square, point),
    ):
        np.testing.assert_array_equal(shapes.along(square.position, actual), corners)
    np.testing.assert_array_equal(
        shapes.along(square.tangent, at), [(1, 0), (0, 1), (-1, 0), (0, -1)]
    )
    np.testing.assert_array_equal(shapes.along(square.tangent, (0.5, -0.125)), [(1, 0), (0, -1)])
    np.testing.assert_array_equal(shapes.along(square.curvature, at), 0)


def test_local_search_stays_on_its_branch_at_a_self_crossing(shapes):
    contour = shapes.cases()["lemniscate"].contour
    crossing = float(contour.length) / 4
    on_branch, on_other = shapes.along(contour.position, (crossing + 0.002, 3 * crossing - 0.002))
    point = 0.3 * on_branch + 0.7 * on_other
    everywhere, local = (
        shapes.nearest_anywhere(contour, point),
        shapes.nearest(contour, point, crossing + 0.002, 0.006),
    )
    assert abs(everywhere - 3 * crossing) < 0.01 and abs(local - crossing) < 0.01
    assert shapes.distance(contour, point, everywhere) < shapes.distance(contour, point, local)


def test_without_reach_or_with_a_point_that_is_not_finite_the_answer_is_the_arc_itself(shapes):
    square, short = shapes.cases()["polygon"].contour, shapes.cases()["line"].contour
    total, end = float(square.length), float(short.length)
    s = np.array([-0.1, 0.0, 0.05, end, 0.3, total, 1.2 * total])
    np.testing.assert_allclose(shapes.nearest(square, (1.0, 1.0), s, 0.0), s % total, atol=1e-16)
    np.testing.assert_array_equal(shapes.nearest(short, (1.0, 1.0), s, -1.0), np.clip(s, 0, end))
    point = np.array([(0.05, 0.001), (np.nan, 0.0), (0.0, np.inf), (-np.inf, 0.0), (0.05, -0.001)])
    np.testing.assert_allclose(
        shapes.nearest(square, point, 0.04, np.inf), (0.05, 0.04, 0.04, 0.04, 0.05), rtol=1e-14
    )
    assert np.isnan(shapes.nearest_anywhere(square, point)).tolist() == [
        False,
        True,
        True,
        True,
        False,
    ]
    np.testing.assert_array_equal(
        shapes.nearest(square, (0.05, 0.01), (np.nan, np.inf, 0.04), (0.1, 0.1, np.nan)),
        (np.nan, np.nan, 0.04),
    )
    assert np.isnan(shapes.along(square.position, (np.nan, np.inf))).all()


def test_window_may_be_wider_than_the_contour_and_cross_its_seam(shapes):
    ring = shapes.cases()["clockwise"].contour
    total, angle = float(ring.length), np.linspace(-3, 3, 7)
    point = 0.03 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for at, reach in ((0.0, 10.0), (0.3 * total, 10.0), (total, 10.0), (total - 1e-3, 0.0615)):
        np.testing.assert_allclose(
            shapes.nearest(ring, point, at, reach), (-0.02 * angle) % total, atol=1e-15
        )


def test_stacked_vmapped_and_mapped_equal_one_by_one(shapes):
    names = ("ellipse", "circle", "polygon", "line")
    together = stack([shapes.cases()[name].contour for name in names])
    assert together.newton_steps > 0 and together.turns and together.axes == 2
    point = np.stack([shapes.points_around(shapes.cases()[name], 40, seed=4) for name in names])
    s, reach = np.linspace(-0.1, 0.4, 40), np.geomspace(1e-4, 0.3, 40)

    def answers(contour, point):
        actual = contour.nearest(point, s, reach)
        return (
            contour.position(actual),
            contour.position(s),
            contour.tangent(s),
            contour.curvature(s),
        )

    vmapped = jax.jit(jax.vmap(answers))(together, point)
    mapped = jax.lax.map(lambda both: answers(*both)[:1], (together, point))
    for i, name in enumerate(names):
        contour = shapes.cases()[name].contour
        expected = [shapes.along(contour.position, shapes.nearest(contour, point[i], s, reach))]
        expected += [
            shapes.along(question, s)
            for question in (contour.position, contour.tangent, contour.curvature)
        ]
        for one, many in zip(expected, vmapped, strict=True):
            np.testing.assert_allclose(many[i], one, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(mapped[0][i], expected[0], atol=1e-11)


@pytest.mark.parametrize("name", ["slot", "helix"])
def test_gradient_of_the_squared_distance_is_twice_the_error(name, shapes):
    contour = shapes.cases()[name].contour
    reach = 0.3 * float(contour.length)
    point = shapes.points_around(shapes.cases()[name], 10, seed=5)
    at = shapes.nearest_anywhere(contour, point)

    @jax.jit
    @jax.vmap
    def square(y, at):
        def value(y, at):
            return jnp.sum((y - contour.position(contour.nearest(y, at, reach))) ** 2)

        return value(y, at), jax.grad(value, argnums=(0, 1))(y, at)

    _, (gradient, along_path) = jax.device_get(square(point, at))
    np.testing.assert_allclose(
        gradient, 2 * (point - shapes.along(contour.position, at)), atol=1e-9
    )
    np.testing.assert_array_equal(along_path, 0)
    for axis, step in enumerate(1e-6 * np.eye(contour.axes)):
        np.testing.assert_allclose(
            gradient[:, axis],
            np.subtract(square(point + step, at)[0], square(point - step, at)[0]) / 2e-6,
            atol=1e-8,
        )


def test_derivative_along_the_contour_is_the_tangent_in_forward_and_reverse_mode(shapes):
    contour = shapes.cases()["slot"].contour
    s = jnp.linspace(-0.05, 0.3, 11)
    forward, reverse, bend = jax.jit(
        jax.vmap(
            lambda s: (
                jax.jacfwd(contour.position)(s),
                jax.jacrev(contour.position)(s),
                jax.grad(contour.curvature)(s),
            )
        )
    )(s)
    np.testing.assert_allclose(forward, shapes.along(contour.tangent, s), atol=1e-6)
    np.testing.assert_allclose(reverse, shapes.along(contour.tangent, s), atol=1e-6)
    assert np.isfinite(bend).all()


def test_float32_stays_float32(shapes):
    wide = shapes.cases()["helix"].contour
    narrow = jax.tree.map(
        lambda rows: rows.astype(np.float32) if rows.dtype == np.float64 else rows, wide
    )
    s = np.linspace(0, float(wide.length), 50)[1:-1]
    point = shapes.along(wide.position, s) + 1e-4

    @jax.jit
    def answers(contour, point, s):
        actual = contour.nearest(point, s, jnp.float32(1e-3))
        return actual, contour.position(actual), contour.tangent(s), contour.curvature(s)

    narrow_answers = answers(narrow, jnp.float32(point), jnp.float32(s))
    assert {x.dtype for x in narrow_answers} == {jnp.dtype("float32")}
    expected = shapes.distance(wide, point, shapes.nearest(wide, point, s, 1e-3))
    np.testing.assert_allclose(
        np.linalg.norm(point - np.asarray(narrow_answers[1]), axis=1), expected, atol=2e-7
    )


@pytest.mark.parametrize("start", [0.3, 2.0, -1.1])
@pytest.mark.parametrize("angle", [0.4, -2.5, 6.0])
def test_the_extremes_of_an_arc_are_found(start, angle):
    """Its ends, and where it crosses an axis."""
    low, high = sorted((start, start + angle))
    quarters = 0.5 * np.pi * np.arange(-4, 6)
    at = np.array([start, *quarters[(low < quarters) & (quarters < high)], start + angle])
    circle = 0.01 * np.stack([np.cos(at), np.sin(at)], axis=1)
    actual = outline(contours.arc(circle[0], [0.0, 0.0], angle))
    np.testing.assert_allclose(actual.min(axis=0), circle.min(axis=0), atol=1e-13)
    np.testing.assert_allclose(actual.max(axis=0), circle.max(axis=0), atol=1e-13)
    np.testing.assert_allclose(actual[[0, -1]], circle[[0, -1]], atol=1e-12)


def test_a_polyline_keeps_its_corners_and_ends_where_it_begins():
    points = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.015], [0.0, 0.0]])
    actual = outline(contours.polyline(points))
    apart = np.linalg.norm(actual[:, None] - points, axis=-1).min(axis=0)
    assert apart.max() < 1e-15 and np.ptp(actual, axis=0) == pytest.approx([0.02, 0.015])
    np.testing.assert_allclose(actual[-1], points[-1], atol=1e-12)
    steps = np.linalg.norm(np.diff(actual, axis=0), axis=1)
    assert steps.sum() == pytest.approx(0.06) and steps.max() < 0.06 / 1000


def test_padding_of_a_stack_is_no_part_of_a_contour():
    pair = contours.stack(
        [contours.line([0.0, 0.0], [1.0, 0.0]), contours.polygon(np.eye(3)[:, :2])]
    )
    first = jax.tree.map(lambda rows: rows[0], pair)
    actual = outline(first)
    assert actual[:, 1].max() == actual[:, 1].min() == 0
    np.testing.assert_allclose([actual[:, 0].min(), actual[:, 0].max()], [0.0, 1.0], atol=1e-12)
