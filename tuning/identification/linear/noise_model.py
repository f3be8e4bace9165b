"""What a model leaves unexplained, as filtered white noise.

    r(k) + w_1 r(k-1) + ... + w_p r(k-p) = e(k),   e white

Behind this filter a fit weighs what is known well more, and its errors are what the command of a
closed loop cannot have caused: with it, records under feedback give no bias (Ljung, System
Identification, 2nd ed., section 13.4), without it they do.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.signal import lfilter

WHITE: Float[np.ndarray, " 1"] = np.ones(1)
FEWEST = 10  # samples for each coefficient
RIDGE = 1e-12  # of a column's squares: a residual of few tones has a filter too


def whitening(residual: Float[np.ndarray, " T"], most: int) -> Float[np.ndarray, " w"]:
    """Filter 1, w_1, ..., w_p that makes a residual white; p of at most `most` by Akaike's number.

    Of a short residual p is at most a tenth of its samples.

    Least squares, not the equations of Yule and Walker: those blur the slow drift that is left of
    an axis with an integrator. The columns are r, its difference and lags of its second difference:
    the same fit, without the near dependence of neighbouring samples of a drift.
    """
    first, second = np.diff(residual), np.diff(residual, 2)  # of samples k-1..k, and k-2..k
    lags = max(min(most, len(residual) // FEWEST), 3) - 2
    rows = len(second) - lags
    place = np.stack([residual[1 + lags : -1], first[lags:-1]])
    past = np.stack([place @ second[lags - i : len(second) - i] for i in range(lags + 1)], axis=1)
    gram = np.empty((lags + 3, lags + 3))  # the second difference itself comes last
    order = np.append(np.arange(1, lags + 1), 0)
    gram[:2, :2], gram[:2, 2:] = place @ place.T, past[:, order]
    gram[2:, :2] = gram[:2, 2:].T
    gram[2:, 2:] = _products(second, lags)[np.ix_(order, order)]
    scale = np.sqrt(np.diag(gram))
    if not scale[-1] > 0:
        return WHITE
    scale = np.where(scale > 0, scale, 1.0)
    gram = gram / np.outer(scale, scale) + RIDGE * np.eye(len(gram))
    triangle = np.linalg.cholesky(gram).T
    left = np.cumsum(triangle[::-1, -1] ** 2)[::-1]  # squares left with 0, 1, ... columns
    criterion = rows * np.log(left) + 2 * np.arange(len(left))
    p = 2 + int(np.argmin(criterion[2:]))
    found = solve_triangular(triangle[:p, :p], triangle[:p, -1]) * scale[-1] / scale[:p]
    ahead = np.concatenate([[1.0], -found[2:]])  # of the second difference
    w = np.convolve(ahead, [1.0, -2.0, 1.0])
    w[1:3] -= found[0] * np.array([1.0, 0.0]) + found[1] * np.array([1.0, -1.0])
    return w


def _products(signal: Float[np.ndarray, " T"], lags: int) -> Float[np.ndarray, "n n"]:
    """Products of a signal with itself, sum_k s(k-i) s(k-j) over k = lags.., of lags 0..`lags`.

    A row follows from the one before by a sample more at the beginning and one less at the end.
    """
    count = len(signal)
    found = np.empty((lags + 1, lags + 1))
    found[0] = [signal[lags:] @ signal[lags - j : count - j] for j in range(lags + 1)]
    begin, end = signal[lags - 1 :: -1], signal[: count - 1 - lags : -1]  # latest first
    for i in range(lags):
        found[i + 1, 0] = found[0, i + 1]
        found[i + 1, 1:] = found[i, :-1] + begin[i] * begin - end[i] * end
    return found


def whitened(signal: Float[np.ndarray, " T"], w: Float[np.ndarray, " w"]) -> np.ndarray:
    """The signal behind a filter, zero before it begins."""
    return np.asarray(lfilter(w, [1.0], signal))
