"""Contours beside parametrised curves in NumPy, and questions of one shape, each compiled once."""

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import jax
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.special import ellipe, gamma

from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import (
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
from jcontour.geometry.toolpaths import Toolpath

MM = 1e-3
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
    """Contours of one kind padded to one shape: each question is compiled once per kind.

    This tests the padding as well.
    """
    kinds: dict[object, list[str]] = {}
    for name, case in made.items():
        kind = "3-D" if case.contour.axes == 3 else (case.contour.newton_steps, case.contour.turns)
        kinds.setdefault(kind, []).append(name)
    for names in kinds.values():
        together = jax.device_get(stack([made[name].contour for name in names]))
        for i, name in enumerate(names):
            made[name] = made[name]._replace(
                contour=jax.tree.map(lambda rows, i=i: rows[i], together)
            )
    return made


def along(question, s) -> np.ndarray:
    """Position, tangent or curvature at any arc lengths, always 4096 at a time.

    Each is therefore compiled once per kind.
    """
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
    actual = contour.nearest(
        np.resize(point, (400, point.shape[1])), np.resize(at, 400), np.resize(reach, 400)
    )
    return np.asarray(actual)[: at.size].reshape(shape)


def nearest_anywhere(contour: Contour, point) -> np.ndarray:
    """`contour.nearest_anywhere` for at most 40 points, always 40 at a time."""
    point = np.asarray(point, float)
    rows = point.reshape(-1, point.shape[-1])
    actual = np.asarray(contour.nearest_anywhere(np.resize(rows, (40, rows.shape[1]))))
    return actual[: len(rows)].reshape(point.shape[:-1])


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
    """Smallest distance to the curve.

    The best three valleys of a dense search are searched again and again more finely.
    """
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


@pytest.fixture(scope="session")
def shapes():
    """The cases, the points they were made from, and the questions to ask of them."""
    return SimpleNamespace(
        SQUARE=SQUARE,
        HEART=HEART,
        cases=cases,
        along=along,
        nearest=nearest,
        nearest_anywhere=nearest_anywhere,
        distance=distance,
        points_around=points_around,
        brute_distance=brute_distance,
    )


def points(toolpath: Toolpath, fractions=(0.0, 0.5, 1.0)) -> np.ndarray:
    """Points of every piece [mm], (P, fractions, m)."""
    pieces = jax.tree.map(lambda rows: np.asarray(rows)[:, None], toolpath.contour.pieces)
    return pieces.jet(np.asarray(fractions) * pieces.extent)[0] / MM


def lengths(toolpath: Toolpath) -> np.ndarray:
    return np.asarray(toolpath.contour.extent) / MM


def assert_valid(toolpath: Toolpath) -> None:
    extent = np.asarray(toolpath.contour.extent)
    assert np.isfinite(extent).all() and (extent > 0).all()
    np.testing.assert_allclose(toolpath.contour.start, np.cumsum(extent) - extent, atol=1e-12)
    ends = points(toolpath, (0.0, 1.0))
    assert np.isfinite(ends).all()
    assert np.linalg.norm(ends[1:, 0] - ends[:-1, 1], axis=-1).max(initial=0.0) < 2e-6  # [mm]
    assert toolpath.feed.shape == toolpath.rapid.shape == extent.shape
    assert (
        np.isnan(toolpath.feed[toolpath.rapid]).all() and (toolpath.feed[~toolpath.rapid] > 0).all()
    )
    assert not toolpath.rapid[0] and not toolpath.rapid[-1]


@pytest.fixture(scope="session")
def traced():
    """Questions to a toolpath: points and lengths of its pieces [mm], and whether it is sound."""
    return SimpleNamespace(points=points, lengths=lengths, assert_valid=assert_valid)
