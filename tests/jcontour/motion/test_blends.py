"""Derivatives of blends against closed forms and differences of their points."""

import numpy as np

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.blending import STEPS, Blends

RIGHT_ANGLE = contours.polyline([[0.0, 0.0], [20e-3, 0.0], [20e-3, 20e-3]])
LINE_AND_ARC = contours.chain(
    [contours.line([0.0, 0.0], [20e-3, 0.0]), contours.arc([20e-3, 0.0], [20e-3, 5e-3], np.pi)]
)


def one(contour, reach: float, corner: bool) -> Blends:
    return Blends(unpadded(contour), np.array([0]), np.array([corner]), np.array([reach]))


def test_deviation_of_a_right_angle_is_known():
    """d |t_1 - t_0| / 8, at the corner."""
    np.testing.assert_allclose(
        one(RIGHT_ANGLE, 1e-3, True).deviation(), 1e-3 * np.sqrt(2) / 8, rtol=1e-12
    )


def test_derivatives_at_the_corner_of_a_right_angle_are_known():
    """In the middle r_u = 0.75 d (1, 1), r_uu = 3 d (-1, 1), r_uuu = 6 d (1, 1)."""
    d = 1e-3
    first, second, third = one(RIGHT_ANGLE, d, True).along()[:, 0, STEPS // 2]
    pace = 0.75 * np.sqrt(2) * d
    np.testing.assert_allclose(first, np.array([1.0, 1.0]) / np.sqrt(2), atol=1e-12)
    np.testing.assert_allclose(second, np.array([-3.0, 3.0]) * d / pace**2, rtol=1e-12)
    # r_s r_ss = 0 everywhere, so that r_s r_sss = -|r_ss|^2; across it is 0 by symmetry
    np.testing.assert_allclose(third, -np.sum(second**2) * first, rtol=1e-9)


def test_derivatives_are_differences_along_the_arc_length():
    for blends in (one(RIGHT_ANGLE, 1e-3, True), one(LINE_AND_ARC, 1e-3, False)):
        u = np.linspace(0.0, 1.0, 3201)
        rows = [blends.quintics().taken(np.zeros(u.size, int)).jet(u)[0]]
        arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(rows[0], axis=0), axis=1)))
        for _ in range(3):
            rows.append(np.gradient(rows[-1], arc, axis=0, edge_order=2))
        every = np.arange(0, u.size, (u.size - 1) // STEPS)[2:-2]
        for order, row in enumerate(blends.along()[:, 0, 2:-2]):
            scale = np.abs(row).max()
            np.testing.assert_allclose(rows[order + 1][every], row, atol=1e-3 * scale)


def test_derivatives_beside_a_jump_of_the_curvature_are_those_of_both_sides():
    _, second, _ = one(LINE_AND_ARC, 1e-3, False).along()[:, 0]
    np.testing.assert_allclose(second[0], [0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(second[-1]), 1 / 5e-3, rtol=1e-9)
