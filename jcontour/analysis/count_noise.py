"""What the counts of encoders make of the control of frozen loops: its RMS, and the slope. Host.

A rounded position is wrong by up to half a count, evenly and anew at every sample: white noise of
standard deviation q / sqrt(12) for counts of length q (Widrow & Kollar, Quantization Noise, 2008).
In the letters of `frozen_loops`, with such noise n(k) on the positions and z(k) = (x, w, n(k-1)):

    z(k+1) = M z(k) + N n(k),        u(k) = C z(k) + F n(k)
For noise of variance 1 the control vector has the mean square

    r^2 = tr(C P C' + F F'),         P = M P M' + N N'
Its slope is that of both equations together, by the adjoint Q = M' Q M + C' C.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.analysis.frequency_response import Encoding
from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine, blocks, turned

DOUBLINGS = 60  # 2^60 samples: no stable loop remembers as long
FORGOTTEN = 1e-16  # of the sum: less is rounding


class _Signals(NamedTuple):
    """Signals of a loop as rows over (x, w, noise one sample before, noise now)."""

    x: Any
    w: Any
    y: Any
    u: Any
    after: Any  # (x, w, noise) one sample later


def count_noise(
    loop: FrozenLoop, encoding: Encoding, deviation: float | Float[np.ndarray, " r"]
) -> tuple[Float[np.ndarray, "*loops"], FrozenLoop]:
    """RMS of the control vector by independent white noises on all positions, and its slope.

    A loop that is not stable has an infinite RMS with slope 0.

    Args:
        loop: batched in front; plant and controller may have different batches that go together.
        encoding: how the sensors show positions.
        deviation: standard deviation of the noise [m], one number or one for each position.

    Returns:
        RMS [control unit], and its derivatives with respect to the matrices of the loop.
    """
    largest = float(np.max(deviation))
    share = deviation / largest  # of the noises, whose largest is the unit
    encoding = encoding._replace(level=encoding.level * share, slope=encoding.slope * share)
    signals = _signals(loop, encoding)
    N = signals.after.shape[-2]
    finite = np.isfinite(signals.after[..., :N]).all(axis=(-2, -1))
    values = np.linalg.eigvals(np.where(finite[..., None, None], signals.after[..., :N], 0.0))
    stable = np.asarray(finite & (np.abs(values).max(axis=-1) < 1))
    if not stable.all():
        at = stable[..., None, None]
        signals = _Signals(*(np.where(at, one, 0.0) for one in signals))
        loop = loop.only(stable)
    u, after = signals.u, signals.after
    M, entry = after[..., :N], after[..., N:]
    P = _summed(M, entry @ turned(entry))
    r = entry.shape[-1]
    spread = blocks([[P, np.zeros((N, r))], [np.zeros((r, N)), np.eye(r)]])
    rms = np.sqrt(np.trace(u @ spread @ turned(u), axis1=-2, axis2=-1))
    Q = _summed(turned(M), turned(u[..., :N]) @ u[..., :N])
    part = largest / np.where(rms > 0, rms, 1.0)
    slope = _slope(loop, signals, Q, part[..., None, None] * spread)
    return np.where(stable, largest * rms, np.inf), slope


def _signals(loop: FrozenLoop, encoding: Encoding) -> _Signals:
    (A, B, H), (W, E, K, D) = loop
    n, c, r = A.shape[-1], W.shape[-1], len(encoding.read)
    x, w, before, now = np.split(np.eye(n + c + 2 * r), [n, n + c, n + c + r])
    with np.errstate(invalid="ignore"):  # a loop that is not finite is not stable either
        y = H @ x + encoding.level @ now + encoding.slope @ (now - before)
        u = D @ y + K @ w
        after = blocks([[A @ x + B @ u], [W @ w + E @ y], [now]])
    return _Signals(x, w, y, u, after)


def _slope(loop: FrozenLoop, signals: _Signals, Q, spread) -> FrozenLoop:
    """Derivatives; `spread` is the covariance of what the rows are over, over the RMS."""
    (A, B, _), (W, E, _, D) = loop
    x, w, y, u, after = signals
    n, c = A.shape[-1], W.shape[-1]
    of_after = Q @ after
    of_x, of_w = of_after[..., :n, :], of_after[..., n : n + c, :]
    of_u = turned(B) @ of_x + u
    of_y = turned(D) @ of_u + turned(E) @ of_w
    return FrozenLoop(
        LinearMachine(*(a @ spread @ turned(b) for a, b in ((of_x, x), (of_x, u), (of_y, x)))),
        LinearLaw(
            *(a @ spread @ turned(b) for a, b in ((of_w, w), (of_w, y), (of_u, w), (of_u, y)))
        ),
    )


def _summed(
    M: Float[np.ndarray, "*loops N N"], first: Float[np.ndarray, "*loops N N"]
) -> Float[np.ndarray, "*loops N N"]:
    """X = M X M' + first, of stable M, by doubling (Smith's method)."""
    total = first
    for _ in range(DOUBLINGS):
        more = M @ total @ turned(M)
        total, M = total + more, M @ M
        if np.abs(more).max(initial=0.0) <= FORGOTTEN * np.abs(total).max(initial=0.0):
            break
    return total
