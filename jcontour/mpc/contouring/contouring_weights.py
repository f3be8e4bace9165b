"""Weights of model predictive contouring control, stated for a unit of length and a period."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from jcontour.qp.problem import check_weight


@dataclass(frozen=True)
class ContouringWeights:
    """Weights of (12) in Lam et al., the defaults are the paper's.

    They hold in a unit of length and for a sample period. At another sample period the same
    integrals over time are weighed: nothing needs to be restated.

    Attributes:
        contour_error: q_c, per length_unit^2.
        lag: q_l, per length_unit^2.
        progress: q_theta, per length_unit; more of it is faster and less accurate.
        control_change: R_x, R_y: one number, one for each input, or a matrix (p, p); per A^2.
        speed_change: R_v, per (length_unit per period)^2.
        length_unit: [m]; the QP is solved in it.
        period: [s].

    Raises:
        ValueError: a weight is negative or not finite, the changes' are zero, or unit or period is
            not above zero.
    """

    contour_error: float = 100.0
    lag: float = 200.0
    progress: float = 0.3  # the middle of the paper's range 0.03 .. 5
    control_change: Any = 60.0
    speed_change: float = 200.0
    length_unit: float = 1e-3
    period: float = 4e-3

    def __post_init__(self):
        for name in ("contour_error", "lag", "progress"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: needs to be finite and at least zero, received {value}")
        for name in ("speed_change", "length_unit", "period"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")

    def control_matrix(self, inputs: int) -> Float[np.ndarray, "p p"]:
        """R_u as a matrix.

        Raises:
            ValueError: it has another shape, or is not symmetric and positive definite.
        """
        R = np.asarray(self.control_change, float)
        if R.ndim < 2:
            if R.size not in (1, inputs):
                raise ValueError(
                    f"control_change: needs one number or one for each of {inputs} inputs, "
                    f"received shape {R.shape}"
                )
            R = np.diag(np.broadcast_to(R, (inputs,)))
        if R.shape != (inputs, inputs):
            raise ValueError(f"control_change: needs shape {(inputs, inputs)}, received {R.shape}")
        check_weight("control_change", R)
        if not np.linalg.eigvalsh(R).min() > 0:
            raise ValueError(
                "control_change: needs to be positive definite, received a singular matrix"
            )
        return R
