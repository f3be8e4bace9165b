"""Contours against independent geometry: parametrised curves in NumPy, dense search refined by SciPy, closed-form lengths."""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.special import ellipe, gamma

import jcontour  # noqa: F401  (switches x64 on)
from jcontour.geometry.contours import (
    Contour,
    arc,
    chain,
    circle,
    ellipse,
    lemniscate,
    line,
    polygon,
    polyline,
    spline,
    stack,
)

ZIGZAG = np.array([(0.0, 0.0), (0.1, 0.0), (0.1, 0.05), (0.02, 0.04), (0.05, -0.03)])
SPATIAL = np.array(
    [
        (0.0, 0.0, 0.0),
        (0.03, 0.05, 0.01),
        (0.1, 0.04, -0.02),
        (0.12, -0.03, 0.03),
        (0.05, -0.05, 0.05),
        (0.0, 0.03, 0.06),
    ]
)
SQUARE = np.array([(0.0, 0.0), (0.125, 0.0), (0.125, 0.125), (0.0, 0.125)])
HEART = np.array(
    [(0.0, 0.0), (0.06, 0.05), (0.03, 0.09), (0.0, 0.05), (-0.03, 0.09), (-0.06, 0.05)]
)


class Case(NamedTuple):
    contour: Contour
    curve: object  # u in [0, 1] -> (..., m), the same points in any parametrisation
    length: float | None  # where a closed form is known


def _polar(centre, radius, first, angle):
    def curve(u):
        phi = first + angle * np.asarray(u)
        return np.asarray(centre) + radius * np.stack([np.cos(phi), np.sin(phi)], axis=-1)

    return curve


def _segments(points):
    chord = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    return lambda u: np.stack(
        [np.interp(np.asarray(u) * chord[-1], chord, column) for column in points.T], axis=-1
    ), chord[-1]


def _cubic(points, bc_type):
    chord = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    cubic = CubicSpline(chord, points, bc_type=bc_type)
    return lambda u: cubic(np.asarray(u) * chord[-1])


def _lemniscate(u, a=0.05):
    t = 2 * np.pi * np.asarray(u)
    x = a * np.cos(t) / (1 + np.sin(t) ** 2)
    return np.stack([x, x * np.sin(t)], axis=-1)


def _helix(u):
    phi = 1.0 + 15.0 * np.asarray(u)
    return np.stack(
        [
            0.02 + 0.04 * np.sin(phi),
            np.full_like(phi, 0.01) + 0.06 * np.asarray(u),
            0.03 + 0.04 * np.cos(phi),
        ],
        axis=-1,
    )


def _tilted(u):
    phi = 2.0 * np.asarray(u)[..., None]
    return np.array([0.03, 0.0, 0.0]) * np.cos(phi) + np.array([0.0, 0.0, 0.03]) * np.sin(phi)


def _joined(*curves):
    def curve(u):
        u = np.asarray(u) * len(curves)
        piece = np.clip(u.astype(int), 0, len(curves) - 1)
        return np.select(
            [piece[..., None] == i for i in range(len(curves))],
            [curve(u - i) for i, curve in enumerate(curves)],
        )

    return curve


@cache
def cases() -> dict[str, Case]:
    closed_zigzag, closed_heart = np.vstack([ZIGZAG, ZIGZAG[:1]]), np.vstack([HEART, HEART[:1]])
    made = {
        "line": Case(
            line((0.01, 0.02), (0.05, -0.03)), *_segments(np.array([(0.01, 0.02), (0.05, -0.03)]))
        ),
        "polyline": Case(polyline(ZIGZAG), *_segments(ZIGZAG)),
        "polygon": Case(polygon(ZIGZAG), *_segments(closed_zigzag)),
        "square": Case(polygon(SQUARE), *_segments(np.vstack([SQUARE, SQUARE[:1]]))),
        "turns": Case(
            arc((0.01, 0.0), (0.0, 0.0), 5 * np.pi),
            _polar((0.0, 0.0), 0.01, 0.0, 5 * np.pi),
            0.05 * np.pi,
        ),
        "arc": Case(
            arc((0.04, 0.0), (0.01, 0.0), -2.5), _polar((0.01, 0.0), 0.03, 0.0, -2.5), 0.075
        ),
        "circle": Case(
            circle(0.03, (0.01, -0.02), 0.7),
            _polar((0.01, -0.02), 0.03, 0.7, 2 * np.pi),
            0.06 * np.pi,
        ),
        "clockwise": Case(
            circle(0.02, clockwise=True), _polar((0.0, 0.0), 0.02, 0.0, -2 * np.pi), 0.04 * np.pi
        ),
        "ellipse": Case(
            ellipse(0.06, 0.03),
            lambda u: _polar((0, 0), 1, 0, 2 * np.pi)(u) * [0.06, 0.03],
            0.24 * ellipe(0.75),
        ),
        "lemniscate": Case(
            lemniscate(0.05), _lemniscate, 0.05 * gamma(0.25) ** 2 / np.sqrt(2 * np.pi)
        ),
        "spline": Case(spline(ZIGZAG), _cubic(ZIGZAG, "not-a-knot"), None),
        "periodic": Case(spline(HEART, closed=True), _cubic(closed_heart, "periodic"), None),
        "spline 3-D": Case(spline(SPATIAL), _cubic(SPATIAL, "not-a-knot"), None),
        "polyline 3-D": Case(polyline(SPATIAL), *_segments(SPATIAL)),
        "arc 3-D": Case(arc((0.03, 0, 0), (0, 0, 0), 2.0, normal=(0, -2, 0)), _tilted, 0.06),
        "helix": Case(
            arc(_helix(0.0), (0.02, 0.01, 0.03), 15.0, (0, 3, 0), rise=0.06),
            _helix,
            float(np.hypot(0.6, 0.06)),
        ),
    }
    bend, leg = made["arc 3-D"], np.array([(0.03, -0.05, 0.0), (0.03, 0.0, 0.0)])
    made["chain 3-D"] = Case(
        chain([line(*leg), bend.contour]), _joined(_segments(leg)[0], _tilted), 0.11
    )
    top, bottom = np.array([(0.02, 0.01), (-0.02, 0.01)]), np.array([(-0.02, -0.01), (0.02, -0.01)])
    right, left = arc((0.02, -0.01), (0.02, 0.0), np.pi), arc((-0.02, 0.01), (-0.02, 0.0), np.pi)
    ends = [
        _polar((x, 0), 0.01, first, np.pi) for x, first in ((0.02, -np.pi / 2), (-0.02, np.pi / 2))
    ]
    slot = _joined(ends[0], _segments(top)[0], ends[1], _segments(bottom)[0])
    made["slot"] = Case(chain([right, line(*top), left, line(*bottom)]), slot, 0.08 + 0.02 * np.pi)
    return _alike(made)


def _alike(made: dict[str, Case]) -> dict[str, Case]:
    """Contours of one kind padded to one shape, so that each question is compiled once per kind; this tests the padding as well."""
    kinds: dict[object, list[str]] = {}
    for name, case in made.items():
        kind = "3-D" if case.contour.axes == 3 else (case.contour.newton_steps, case.contour.turns)
        kinds.setdefault(kind, []).append(name)
    for names in kinds.values():
        together = stack([made[name].contour for name in names])
        for i, name in enumerate(names):
            made[name] = made[name]._replace(
                contour=jax.tree.map(lambda rows, i=i: rows[i], together)
            )
    return made


NAMES = list(cases())
CLOSED = {"polygon", "square", "circle", "clockwise", "ellipse", "lemniscate", "periodic", "slot"}


def along(question, s) -> np.ndarray:
    """Ask for position, tangent or curvature at any arc lengths, always 4096 at a time, so that each is compiled once per kind."""
    s = np.asarray(s, float)
    rows = np.resize(np.append(s.ravel(), 0.0), (-(-s.size // 4096), 4096))
    answer = np.concatenate([np.asarray(question(row)) for row in rows])
    return answer[: s.size].reshape(s.shape + answer.shape[1:])


def nearest(contour: Contour, point, at, reach) -> np.ndarray:
    """`contour.nearest` for at most 400 points, always 400 at a time."""
    point = np.asarray(point, float)
    shape = np.broadcast_shapes(point.shape[:-1], np.shape(at), np.shape(reach))
    at, reach = np.broadcast_to(at, shape).ravel(), np.broadcast_to(reach, shape).ravel()
    point = np.broadcast_to(point, shape + point.shape[-1:]).reshape(-1, point.shape[-1])
    found = contour.nearest(
        np.resize(point, (400, point.shape[1])), np.resize(at, 400), np.resize(reach, 400)
    )
    return np.asarray(found)[: at.size].reshape(shape)


def nearest_anywhere(contour: Contour, point) -> np.ndarray:
    """`contour.nearest_anywhere` for at most 40 points, always 40 at a time."""
    point = np.asarray(point, float)
    rows = point.reshape(-1, point.shape[-1])
    found = np.asarray(contour.nearest_anywhere(np.resize(rows, (40, rows.shape[1]))))
    return found[: len(rows)].reshape(point.shape[:-1])


def distance(contour: Contour, point, at) -> np.ndarray:
    return np.linalg.norm(point - along(contour.position, at), axis=-1)


def points_around(case: Case, count: int, seed: int) -> np.ndarray:
    """Half of them near the curve at distances of all sizes, half anywhere around it."""
    rng = np.random.default_rng(seed)
    on = case.curve(rng.random(count // 2))
    near = on + rng.standard_normal(on.shape) * 0.01 * 10.0 ** rng.uniform(-6, 0, (len(on), 1))
    low, high = on.min(axis=0), on.max(axis=0)
    return np.concatenate([near, low + (high - low) * rng.uniform(-0.3, 1.3, on.shape)])


def brute_distance(curve, point) -> float:
    """Smallest distance to the curve: the best three valleys of a dense search, each searched again and again more finely."""
    u = np.linspace(0, 1, 4001)
    distance = np.linalg.norm(curve(u) - point, axis=-1)
    valley = np.flatnonzero(
        (distance <= np.roll(distance, 1)) & (distance <= np.roll(distance, -1))
    )
    best, zoom = np.inf, np.linspace(-1, 1, 41)
    for around in u[valley[np.argsort(distance[valley])[:3]]]:
        for width in 3e-4 * 15.0 ** -np.arange(8):
            finer = np.clip(around + width * zoom, 0, 1)
            distance = np.linalg.norm(curve(finer) - point, axis=-1)
            around = finer[np.argmin(distance)]
            best = min(best, distance.min())
    return best


@pytest.mark.parametrize("name", NAMES)
def test_positions_lie_on_the_curve_from_end_to_end(name):
    contour, curve, length = cases()[name]
    total = float(contour.length)
    assert bool(contour.closed) == (name in CLOSED)
    if length is not None:
        assert total == pytest.approx(length, rel=1e-12)
    position = along(contour.position, np.linspace(0, total, 40))
    np.testing.assert_allclose(position[[0, -1]], curve(np.array([0.0, 1.0])), atol=2e-15)
    assert (
        max(brute_distance(curve, point) for point in position) <= float(contour.fit_error) + 1e-13
    )
    box = curve(np.linspace(0, 1, 20001))
    assert float(contour.size) == pytest.approx(np.linalg.norm(np.ptp(box, axis=0)), rel=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_tangent_and_curvature_are_the_derivatives(name):
    contour = cases()[name].contour
    total, h = float(contour.length), 1e-5
    s = np.random.default_rng(0).uniform(2 * h, total - 2 * h, 300)
    s = s[np.min(np.abs(s[:, None] - np.asarray(contour.start)), axis=1) > 2 * h]  # off the corners
    stencil = along(contour.position, s[:, None] + h * np.array([-2, -1, 0, 1, 2]))
    velocity = np.einsum("i,sim->sm", np.array([1, -8, 0, 8, -1]) / (12 * h), stencil)
    acceleration = np.einsum("i,sim->sm", np.array([-1, 16, -30, 16, -1]) / (12 * h**2), stencil)
    tangent = along(contour.tangent, s)
    np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(tangent, velocity, atol=2e-7)
    np.testing.assert_allclose(
        along(contour.curvature, s), np.linalg.norm(acceleration, axis=1), atol=2e-4, rtol=1e-4
    )
    np.testing.assert_allclose(
        along(contour.curvature_vector, s), acceleration, atol=2e-3
    )  # fits are not quite in arc length


@pytest.mark.parametrize("name", NAMES)
def test_nearest_anywhere_is_the_nearest_point_of_the_true_curve(name):
    contour, curve, _ = cases()[name]
    point = points_around(cases()[name], 40, seed=1)
    found = distance(contour, point, nearest_anywhere(contour, point))
    expected = np.array([brute_distance(curve, y) for y in point])
    np.testing.assert_allclose(found, expected, atol=float(contour.fit_error) + 2e-12)
    for y, least in zip(
        point[::10], found[::10], strict=True
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
def test_nearest_is_the_nearest_point_within_reach(name):
    contour = cases()[name].contour
    total, rng = float(contour.length), np.random.default_rng(2)
    point = points_around(cases()[name], 400, seed=3)
    at = rng.uniform(-0.2 * total, 1.2 * total, 400)
    reach = total * 10.0 ** rng.uniform(-4, 0.2, 400)
    found = nearest(contour, point, at, reach)
    if bool(contour.closed):
        away = np.abs((found - at + total / 2) % total - total / 2)
        window = at[:, None] + np.minimum(reach, total / 2)[:, None] * np.linspace(-1, 1, 401)
    else:
        away = np.abs(found - np.clip(at, 0, total))
        window = np.clip(
            np.clip(at, 0, total)[:, None] + reach[:, None] * np.linspace(-1, 1, 401), 0, total
        )
    assert np.all((found >= 0) & (found <= total)) and np.all(away <= reach + 1e-14)
    least = distance(contour, point, found)
    assert np.all(least <= distance(contour, point[:, None], window).min(axis=1) + 1e-11)
    wide = np.flatnonzero(reach >= total)[:40]
    np.testing.assert_allclose(
        least[wide],
        distance(contour, point[wide], nearest_anywhere(contour, point[wide])),
        atol=1e-11,
    )


@pytest.mark.parametrize("name", ["ellipse", "lemniscate", "periodic", "spline 3-D"])
def test_fit_error_bounds_the_distance_everywhere(name):
    contour, curve, _ = cases()[name]
    position, dense = (
        along(contour.position, np.linspace(0, float(contour.length), 4000)),
        curve(np.linspace(0, 1, 200_001)),
    )
    _, i = cKDTree(dense).query(position)
    chord = dense[np.minimum(i + 1, len(dense) - 1)] - dense[np.maximum(i - 1, 0)]
    chord /= np.linalg.norm(chord, axis=1, keepdims=True)
    gap = position - dense[i]
    across = np.linalg.norm(gap - np.sum(gap * chord, axis=1, keepdims=True) * chord, axis=1)
    assert 0 < float(contour.fit_error) <= 1e-10
    assert across.max() <= float(contour.fit_error) + 3e-12  # the sagitta between dense points


def test_tolerance_sets_the_number_of_pieces():
    coarse, fine = ellipse(0.06, 0.03, tolerance=1e-6), ellipse(0.06, 0.03)
    assert coarse.rate.size < fine.rate.size and 1e-10 < float(coarse.fit_error) <= 1e-6
    with pytest.raises(ValueError, match="ellipse.*tolerance"):
        ellipse(0.06, 0.03, tolerance=1e-25)


def test_circle_is_one_exact_piece():
    assert (
        circle(0.03).rate.size == 1
        and circle(0.03).newton_steps == 0
        and circle(0.03).fit_error == 0
    )
    assert float(circle(0.03).size) == pytest.approx(0.06 * np.sqrt(2), rel=1e-14)
    np.testing.assert_allclose(
        along(cases()["circle"].contour.curvature, np.linspace(-1, 1, 9)), 1 / 0.03, rtol=1e-13
    )


def test_several_turns_and_whole_turns_of_an_arc():
    contour = cases()["turns"].contour
    total = float(contour.length)
    found = nearest(contour, (0.02, 0.001), np.array([0.0, 0.4, 0.8]) * total, 0.2 * total)
    np.testing.assert_allclose(
        found, 0.01 * (np.arctan2(0.001, 0.02) + 2 * np.pi * np.arange(3)), rtol=1e-12
    )
    assert bool(arc((0.01, 0.0), (0.0, 0.0), 2 * np.pi).closed) and not bool(contour.closed)


def test_open_contours_go_straight_on():
    contour = cases()["arc"].contour
    total = float(contour.length)
    start, end = along(contour.tangent, (0.0, total))
    np.testing.assert_allclose(
        along(contour.position, (-0.02, total + 0.02)),
        along(contour.position, (0, total)) + [-0.02 * start, 0.02 * end],
    )
    np.testing.assert_array_equal(along(contour.tangent, (-1.0, total + 1.0)), [start, end])
    np.testing.assert_allclose(
        along(contour.curvature, (-0.01, total + 0.01, 0.0, total)), (0, 0, 1 / 0.03, 1 / 0.03)
    )


@pytest.mark.parametrize("name", sorted(CLOSED))
def test_closed_contours_wrap(name):
    contour = cases()[name].contour
    total = float(contour.length)
    s = np.linspace(0, total, 20, endpoint=False) + 1e-4
    np.testing.assert_allclose(
        along(contour.position, s - 2 * total), along(contour.position, s), atol=1e-14
    )
    np.testing.assert_allclose(
        along(contour.tangent, s + total), along(contour.tangent, s), atol=1e-11
    )


def test_corners_are_exact_and_belong_to_the_piece_that_begins_there():
    square, corners, outward = (
        cases()["square"].contour,
        SQUARE,
        np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]),
    )
    at = np.array([0.0, 0.125, 0.25, 0.375])
    point = corners + 1e-3 * outward
    for found in (
        nearest(square, point, at + 0.003, 0.01),
        nearest(square, point, at - 0.003, 0.01),
        nearest_anywhere(square, point),
    ):
        np.testing.assert_array_equal(along(square.position, found), corners)
    np.testing.assert_array_equal(along(square.tangent, at), [(1, 0), (0, 1), (-1, 0), (0, -1)])
    np.testing.assert_array_equal(along(square.tangent, (0.5, -0.125)), [(1, 0), (0, -1)])
    np.testing.assert_array_equal(along(square.curvature, at), 0)


def test_local_search_stays_on_its_branch_at_a_self_crossing():
    contour = cases()["lemniscate"].contour
    crossing = float(contour.length) / 4
    on_branch, on_other = along(contour.position, (crossing + 0.002, 3 * crossing - 0.002))
    point = 0.3 * on_branch + 0.7 * on_other
    everywhere, local = (
        nearest_anywhere(contour, point),
        nearest(contour, point, crossing + 0.002, 0.006),
    )
    assert abs(everywhere - 3 * crossing) < 0.01 and abs(local - crossing) < 0.01
    assert distance(contour, point, everywhere) < distance(contour, point, local)


def test_without_reach_or_with_a_point_that_is_not_finite_the_answer_is_the_arc_itself():
    square, short = cases()["polygon"].contour, cases()["line"].contour
    total, end = float(square.length), float(short.length)
    s = np.array([-0.1, 0.0, 0.05, end, 0.3, total, 1.2 * total])
    np.testing.assert_allclose(nearest(square, (1.0, 1.0), s, 0.0), s % total, atol=1e-16)
    np.testing.assert_array_equal(nearest(short, (1.0, 1.0), s, -1.0), np.clip(s, 0, end))
    point = np.array([(0.05, 0.001), (np.nan, 0.0), (0.0, np.inf), (-np.inf, 0.0), (0.05, -0.001)])
    np.testing.assert_allclose(
        nearest(square, point, 0.04, np.inf), (0.05, 0.04, 0.04, 0.04, 0.05), rtol=1e-14
    )
    assert np.isnan(nearest_anywhere(square, point)).tolist() == [False, True, True, True, False]
    np.testing.assert_array_equal(
        nearest(square, (0.05, 0.01), (np.nan, np.inf, 0.04), (0.1, 0.1, np.nan)),
        (np.nan, np.nan, 0.04),
    )
    assert np.isnan(along(square.position, (np.nan, np.inf))).all()


def test_window_may_be_wider_than_the_contour_and_cross_its_seam():
    ring = cases()["clockwise"].contour
    total, angle = float(ring.length), np.linspace(-3, 3, 7)
    point = 0.03 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for at, reach in ((0.0, 10.0), (0.3 * total, 10.0), (total, 10.0), (total - 1e-3, 0.0615)):
        np.testing.assert_allclose(
            nearest(ring, point, at, reach), (-0.02 * angle) % total, atol=1e-15
        )


def test_stacked_vmapped_and_mapped_equal_one_by_one():
    names = ("ellipse", "circle", "polygon", "line")
    together = stack([cases()[name].contour for name in names])
    assert together.newton_steps > 0 and together.turns and together.axes == 2
    point = np.stack([points_around(cases()[name], 40, seed=4) for name in names])
    s, reach = np.linspace(-0.1, 0.4, 40), np.geomspace(1e-4, 0.3, 40)

    def answers(contour, point):
        found = contour.nearest(point, s, reach)
        return (
            contour.position(found),
            contour.position(s),
            contour.tangent(s),
            contour.curvature(s),
        )

    vmapped = jax.jit(jax.vmap(answers))(together, point)
    mapped = jax.lax.map(lambda both: answers(*both)[:1], (together, point))
    for i, name in enumerate(names):
        contour = cases()[name].contour
        expected = [along(contour.position, nearest(contour, point[i], s, reach))]
        expected += [
            along(question, s)
            for question in (contour.position, contour.tangent, contour.curvature)
        ]
        for one, many in zip(expected, vmapped, strict=True):
            np.testing.assert_allclose(many[i], one, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(mapped[0][i], expected[0], atol=1e-11)


def test_vmap_over_points_equals_a_loop():
    contour = cases()["slot"].contour
    point, s, reach = (
        points_around(cases()["slot"], 40, seed=6),
        np.linspace(-0.1, 0.4, 40),
        np.geomspace(1e-4, 0.3, 40),
    )
    expected = nearest(contour, point, s, reach)
    np.testing.assert_allclose(jax.vmap(contour.nearest)(point, s, reach), expected, atol=1e-14)
    np.testing.assert_allclose(
        [contour.nearest(*each) for each in zip(point, s, reach, strict=True)], expected, atol=1e-14
    )


@pytest.mark.parametrize("name", ["slot", "helix"])
def test_gradient_of_the_squared_distance_is_twice_the_error(name):
    contour = cases()[name].contour
    reach = 0.3 * float(contour.length)
    point = points_around(cases()[name], 10, seed=5)
    at = nearest_anywhere(contour, point)

    @jax.jit
    @jax.vmap
    def square(y, at):
        def value(y, at):
            return jnp.sum((y - contour.position(contour.nearest(y, at, reach))) ** 2)

        return value(y, at), jax.grad(value, argnums=(0, 1))(y, at)

    _, (gradient, along_path) = square(point, at)
    np.testing.assert_allclose(gradient, 2 * (point - along(contour.position, at)), atol=1e-9)
    np.testing.assert_array_equal(along_path, 0)
    for axis, step in enumerate(1e-6 * np.eye(contour.axes)):
        np.testing.assert_allclose(
            gradient[:, axis],
            (square(point + step, at)[0] - square(point - step, at)[0]) / 2e-6,
            atol=1e-8,
        )


def test_derivative_along_the_contour_is_the_tangent_in_forward_and_reverse_mode():
    contour = cases()["slot"].contour
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
    np.testing.assert_allclose(forward, along(contour.tangent, s), atol=1e-6)
    np.testing.assert_allclose(reverse, along(contour.tangent, s), atol=1e-6)
    assert np.isfinite(bend).all()


def test_float32_stays_float32():
    wide = cases()["helix"].contour
    narrow = jax.tree.map(
        lambda rows: rows.astype(np.float32) if rows.dtype == np.float64 else rows, wide
    )
    s = np.linspace(0, float(wide.length), 50)[1:-1]
    point = along(wide.position, s) + 1e-4

    @jax.jit
    def answers(contour, point, s):
        found = contour.nearest(point, s, jnp.float32(1e-3))
        return found, contour.position(found), contour.tangent(s), contour.curvature(s)

    narrow_answers = answers(narrow, jnp.float32(point), jnp.float32(s))
    assert {x.dtype for x in narrow_answers} == {jnp.dtype("float32")}
    expected = distance(wide, point, nearest(wide, point, s, 1e-3))
    np.testing.assert_allclose(
        np.linalg.norm(point - np.asarray(narrow_answers[1]), axis=1), expected, atol=2e-7
    )


def test_repeated_points_are_dropped_and_a_polyline_back_to_its_start_is_closed():
    repeated = polyline([(0, 0), (0, 0), (0.1, 0), (0.1, 0), (0.1, 0.1), (0.1, 0.1)])
    assert repeated.rate.size == 2 and not bool(repeated.closed)
    assert bool(polyline([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0)]).closed)
    assert polygon([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0)]).rate.size == 3
    assert polygon([(0, 0), (0.1, 0), (0.1, 0.1), (1e-17, 0)]).rate.size == 3
    nearly = spline(np.vstack([HEART, HEART[:1] + 1e-17]), closed=True)
    assert bool(nearly.closed) and float(nearly.length) == pytest.approx(
        float(cases()["periodic"].contour.length), rel=1e-12
    )
    assert float(spline([(0, 0), (0, 0), (0.3, 0.4)]).length) == pytest.approx(0.5, rel=1e-14)


def test_chain_names_the_gap():
    with pytest.raises(
        ValueError,
        match=r"chain: contour 1 ends at \[0.2, 0.0\] but contour 2 starts at .*0.001 m apart",
    ):
        chain([line((0, 0), (0.1, 0)), line((0.1, 0), (0.2, 0)), line((0.2, 0.001), (0.3, 0))])
    joined = chain([line((0, 0), (0.1, 0)), line((0.1, 1e-12), (0.2, 0))])
    assert joined.rate.size == 2
    again = chain(
        [chain([line((0, 0), (0.1, 0)), line((0.1, 0), (0.1, 0.1))]), line((0.1, 0.1), (0, 0))]
    )
    assert again.rate.size == 3 and bool(again.closed)


NAN = float("nan")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: line((0, 0), (0, 0)), "2 distinct points"),
        (lambda: line((0, 0), (0, 1, 2)), "line|regular"),
        (lambda: line((0, 0), (0, NAN)), "finite"),
        (lambda: polyline([(0, 0)]), "2 distinct points"),
        (lambda: polyline(np.zeros((0, 2))), "2 distinct points"),
        (lambda: polyline([(0, 0), (1e-200, 0)]), "distinct"),
        (lambda: polyline([(0, 0), (1e200, 0)]), "finite"),
        (lambda: polyline([(0, 0), (1e-120, 0)]), "length above zero"),
        (lambda: polyline(np.zeros((3, 4))), r"\(n, 2\) or \(n, 3\), received shape \(3, 4\)"),
        (lambda: polyline([0.0, 1.0]), "shape"),
        (lambda: polyline([(0, 0), (np.inf, 0)]), "finite"),
        (lambda: polyline([("a", "b"), (0, 0)]), "numbers"),
        (lambda: polygon([(0, 0), (0, 0)]), "2 distinct points"),
        (lambda: circle(0.0), "radius: needs to be above zero, received 0"),
        (lambda: circle(-1.0), "above zero"),
        (lambda: circle(1e-300), "above zero"),
        (lambda: circle(NAN), "finite"),
        (lambda: circle(np.ones(2)), "one number"),
        (lambda: circle(1.0, centre=(0,)), "centre"),
        (lambda: ellipse(0.1, 0.0), "ellipse b"),
        (lambda: ellipse(0.1, 1e-30), "tolerance"),
        (lambda: lemniscate(-0.1), "lemniscate"),
        (lambda: spline([(0, 0), (1, 1)], closed=True), "3 distinct points"),
        (lambda: spline([(0, 0), (0, 1)], tolerance=0.0), "tolerance"),
        (lambda: arc((0, 0), (0, 0), 1.0), "radius"),
        (lambda: arc((1, 0), (0, 0), 0.0), "angle"),
        (lambda: arc((1, 0), (0, 0), np.inf), "finite"),
        (lambda: arc((1, 0), (0, 0, 0), 1.0), "same number of axes"),
        (lambda: arc((1, 0), (0, 0), 1.0, rise=0.1), "two axes"),
        (lambda: arc((1, 0), (0, 0), 1.0, normal=(1, 0, 0)), "two axes"),
        (lambda: arc((1, 0, 0), (0, 0, 0), 1.0, normal=(0, 0, 0)), "normal"),
        (lambda: arc((1, 0, 0), (0, 0, 0), 1.0, normal=(1, 0, 1)), "right angles"),
        (lambda: chain([]), "at least one"),
        (lambda: chain([line((0, 0), (0, 1)), line((0, 1, 0), (0, 0, 0))]), "same number of axes"),
        (lambda: chain([stack([circle(0.1)])]), "single contours"),
        (lambda: stack([]), "at least one"),
        (lambda: stack([line((0, 0), (0, 1)), line((0, 1, 0), (0, 0, 0))]), "same number of axes"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_bad_input_is_refused_in_one_line(any_type, make, says):
    with pytest.raises(ValueError, match=says) as refusal:
        make()
    assert "\n" not in str(refusal.value)
