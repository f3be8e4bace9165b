import numpy as np
import pytest

from jcontour.qp.hildreth import SWEEPS, ascent
from jcontour.qp.problem import QP, residuals


def test_two_parallel_coordinates_by_hand():
    """minimise |z - (2, 0)|^2 / 2 under z_1 + z_2 <= 1 and z_1 <= 1.

    z = (1, 0) with multipliers 1 on z_1 and 0 on the row.
    """
    inf = np.inf
    qp = QP(
        np.eye(2),
        np.array([-2.0, 0.0]),
        np.ones((1, 2)),
        np.array([-inf]),
        np.ones(1),
        np.full(2, -inf),
        np.array([1.0, inf]),
    )
    z, multipliers, sweeps = ascent(*qp)
    np.testing.assert_allclose(z, [1.0, 0.0], atol=1e-10)
    np.testing.assert_allclose(multipliers, [1.0, 0.0, 0.0], atol=1e-10)
    assert sweeps < SWEEPS


def test_no_limit_takes_one_sweep():
    random = np.random.default_rng(0)
    M, inf = random.standard_normal((6, 6)), np.full(6, np.inf)
    qp = QP(
        M @ M.T + np.eye(6),
        random.standard_normal(6),
        np.zeros((0, 6)),
        np.zeros(0),
        np.zeros(0),
        -inf,
        inf,
    )
    z, multipliers, sweeps = ascent(*qp)
    np.testing.assert_allclose(z, np.linalg.solve(qp.H, -qp.g), rtol=1e-10)
    assert sweeps == 1 and not multipliers.any() and max(residuals(*qp, z, multipliers)) <= 1e-12


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_multipliers_that_only_fall_are_climbed_to_their_end(side):
    """The free minimum lies beyond both limits at zero: z = 0, with multipliers -g.

    Both rise, or both fall, by a quarter of what is left in every sweep.
    """
    H, g = np.linalg.inv([[1.0, -0.5], [-0.5, 1.0]]), -side * np.array([2.0, 3.0])
    low, high = (-np.inf, 0.0) if side > 0 else (0.0, np.inf)
    z, multipliers, sweeps = ascent(
        H, g, np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.full(2, low), np.full(2, high)
    )
    np.testing.assert_allclose(z, 0.0, atol=1e-12)
    np.testing.assert_allclose(multipliers, -g, rtol=1e-11)
    assert 10 < sweeps < 40
