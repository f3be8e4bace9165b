"""Residuals against their definition in NumPy, and the checks of a problem."""

import numpy as np
import pytest

from jcontour.qp.problem import (
    QP,
    Solution,
    Unsolved,
    check_limits,
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
    assert residuals(qp, z, forces) == pytest.approx((primal, dual, gap), rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("row", [False, True])
def test_a_multiplier_without_a_limit_is_no_answer(row, sign):
    """z^2 / 2 - z at z = 0, which only a force against an infinite limit could hold there."""
    inf = np.array([np.inf])
    free = QP(np.eye(1), np.array([-sign]), np.eye(1), -inf, inf, -inf, inf)
    multipliers = sign * np.array([0.0, 1.0] if row else [1.0, 0.0])
    assert residuals(free, np.zeros(1), multipliers) == (0.0, 1.0, 0.0)


def test_a_cost_in_small_units_is_not_waved_through():
    qp = some_qp()
    small = qp._replace(H=1e-12 * qp.H, g=1e-12 * qp.g)
    assert residuals(small, np.full(4, 0.5), np.zeros(7))[1] > 0.1


def test_nan_stays_nan():
    qp = some_qp()
    for name in ("H", "g", "C"):
        broken = qp._replace(**{name: np.full_like(getattr(qp, name), np.nan)})
        assert np.isnan(residuals(broken, np.zeros(4), np.ones(7))[1:]).all()
    assert np.isnan(residuals(qp, np.full(4, np.nan), np.zeros(7))).all()


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


@pytest.mark.parametrize(
    ("message", "changed"),
    [
        (r"H: needs shape \(4, 4\), received \(3, 3\)", {"H": np.eye(3)}),
        (r"C: needs shape \(3, 4\), received \(3, 5\)", {"C": np.ones((3, 5))}),
        (r"upper: needs shape \(4,\), received \(2,\)", {"upper": np.ones(2)}),
    ],
)
def test_bad_shapes(message, changed):
    check_shapes(some_qp())
    with pytest.raises(ValueError, match=f"^{message}"):
        check_shapes(some_qp()._replace(**changed))


def test_bad_limits():
    check_limits("z", -np.inf, np.ones(3))
    with pytest.raises(ValueError, match=r"^z: .* lower <= upper, received 2.0 and 1.0 in entry 0"):
        check_limits("z", 2.0, np.ones(3))
    with pytest.raises(ValueError, match=r"^z: the limits need lower <= upper, received nan"):
        check_limits("z", np.nan, np.ones(3))


def test_bad_weights():
    check_weight("Q", np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"^Q: needs to be square, received \(2, 3\)"):
        check_weight("Q", np.zeros((2, 3)))
    with pytest.raises(ValueError, match="^Q: every entry needs to be finite"):
        check_weight("Q", np.full((2, 2), np.nan))
    with pytest.raises(ValueError, match="^Q: needs to be symmetric"):
        check_weight("Q", np.eye(4) + np.eye(4, k=1))
    with pytest.raises(ValueError, match="^Q: needs to be positive semidefinite, .* of -1"):
        check_weight("Q", np.diag([1.0, 1.0, 1.0, -1.0]))
