"""Residuals against their definition in NumPy, and the checks of a problem."""

import numpy as np
import pytest

from jcontour.qp.problem import (
    QP,
    Solution,
    Unsolved,
    check_limits,
    check_qp,
    check_shapes,
    check_weight,
    residuals,
)


def some_qp(n=4, r=3, seed=0):
    random = np.random.default_rng(seed)
    M = random.standard_normal((n, n))
    return QP(
        M @ M.T,
        random.standard_normal(n),
        random.standard_normal((r, n)),
        -np.ones(r),
        np.ones(r),
        -np.ones(n),
        np.ones(n),
    )


@pytest.mark.parametrize("seed", range(5))
def test_residuals_are_their_definition(seed):
    qp, random = some_qp(seed=seed), np.random.default_rng(seed)
    z, forces = 2 * random.standard_normal(4), 5 * random.standard_normal(7)
    rows, low, high = (
        np.vstack([np.eye(4), qp.C]),
        np.append(qp.lower, qp.lower_rows),
        np.append(qp.upper, qp.upper_rows),
    )
    pull = rows.T @ forces
    scale = max(
        min(1, np.abs(qp.H).max()), *(np.abs(part).max() for part in (qp.H @ z, qp.g, pull))
    )
    primal = max(np.max(rows @ z - high), np.max(low - rows @ z), 0)
    dual = np.abs(qp.H @ z + qp.g + pull).max() / scale
    gap = abs(z @ qp.H @ z + qp.g @ z + np.where(forces > 0, high, low) @ forces) / scale
    assert residuals(*qp, z, forces) == pytest.approx((primal, dual, gap), rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("row", [False, True])
def test_a_multiplier_without_a_limit_is_no_answer(row, sign):
    """z^2 / 2 - z at z = 0, which only a force against an infinite limit could hold there."""
    inf = np.array([np.inf])
    free = QP(np.eye(1), np.array([-sign]), np.eye(1), -inf, inf, -inf, inf)
    multipliers = sign * np.array([0.0, 1.0] if row else [1.0, 0.0])
    assert residuals(*free, np.zeros(1), multipliers) == (0.0, 1.0, 0.0)


def test_a_cost_in_small_units_is_not_waved_through():
    qp = some_qp()
    small = qp._replace(H=1e-12 * qp.H, g=1e-12 * qp.g)
    assert residuals(*small, np.full(4, 0.5), np.zeros(7))[1] > 0.1


def test_nan_stays_nan():
    qp = some_qp()
    for name in ("H", "g", "C"):
        broken = qp._replace(**{name: np.full_like(getattr(qp, name), np.nan)})
        assert np.isnan(residuals(*broken, np.zeros(4), np.ones(7))[1:]).all()
    assert np.isnan(residuals(*qp, np.full(4, np.nan), np.zeros(7))).all()


def test_unsolved_is_one_line_and_keeps_a_copy():
    qp = some_qp()
    error = Unsolved("daqp", "infeasible", qp, (1e-3, 2.0, 0.5))
    assert str(error) == (
        "daqp did not solve the QP (4 variables, 3 rows): infeasible; "
        "residuals primal 0.001, dual 2, gap 0.5"
    )
    error.step = 12
    assert str(error).startswith("step 12: daqp")
    qp.g[:] = 7.0
    assert not np.any(error.qp.g == 7.0)


def test_the_largest_residual():
    assert Solution(np.zeros(1), np.zeros(1), 1e-12, 3e-10, 2e-11, "daqp", 1).residual == 3e-10


BAD = {
    r"H: needs shape \(4, 4\), received \(3, 3\)": dict(H=np.eye(3)),
    r"C: needs shape \(3, 4\), received \(3, 5\)": dict(C=np.ones((3, 5))),
    r"upper: needs shape \(4,\), received \(2,\)": dict(upper=np.ones(2)),
    "g: every entry needs to be finite": dict(g=np.full(4, np.inf)),
    "C: every entry needs to be finite": dict(C=np.full((3, 4), np.nan)),
    r"lower, upper: the limits need lower <= upper, received 2.0 and 1.0 in entry 0": dict(
        lower=np.full(4, 2.0)
    ),
    "lower_rows, upper_rows: the limits need lower <= upper, received nan": dict(
        lower_rows=np.full(3, np.nan)
    ),
    "H: needs to be symmetric": dict(H=np.eye(4) + np.eye(4, k=1)),
    "H: needs to be positive semidefinite, received an eigenvalue of -1": dict(
        H=np.diag([1.0, 1.0, 1.0, -1.0])
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_a_bad_problem(message):
    with pytest.raises(ValueError, match=f"^{message}"):
        check_qp(some_qp()._replace(**BAD[message]))


def test_good_problems_pass():
    check_qp(some_qp())
    check_shapes(some_qp())
    check_limits("z", -np.inf, np.ones(3))
    check_weight("Q", np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"^Q: needs to be square, received \(2, 3\)"):
        check_weight("Q", np.zeros((2, 3)))
