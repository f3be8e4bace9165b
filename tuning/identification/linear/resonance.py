"""Where a resonance may be beside a model that has none.

A fit that begins at smooth models falls into one of them when the record shows a resonance by its
corners only. So a pair of poles is laid on a grid of frequencies and dampings,

    z = exp((-zeta +- i sqrt(1 - zeta^2)) w),

beside the poles of the model, and the numerator behind every delay is found by linear least squares
under the model's noise filter. The delays of a pair share one QR factorisation.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.noise_model import whitened
from tuning.identification.linear.output_error import (
    AxisFit,
    AxisRecord,
    Structure,
    driven,
    shifted,
    solved,
)
from tuning.identification.linear.pieces import free_start, started_apart
from tuning.identification.linear.triangles import triangle_of

FREQUENCIES = np.geomspace(0.05, 1.5, 13)  # [rad/sample]: 8 to 240 Hz of 1 kHz
DAMPINGS = (0.05, 0.2)


def with_resonance(record: AxisRecord, base: AxisFit) -> AxisModel:
    """The model with the pair of poles, numerator and delay that leave the least of a record.

    Args:
        record: of the axis.
        base: model without the pair, with its noise filter; the delay is at most its own.
    """
    smooth, drag = base.model, zip(base.drag, record.drags, strict=True)
    i, poles = smooth.integrators, len(smooth.denominator) + 2
    structure = Structure(poles, poles + i, i, 0)
    command = record.command + sum(f * _ahead(signal, smooth.delay) for f, signal in drag)
    drive = whitened(driven(command, structure), base.filter)
    position = whitened(record.position - record.position[0], base.filter)
    smooth_below = np.concatenate([[1.0], smooth.denominator])
    tried = []
    for pair in _pairs():
        below = np.convolve(smooth_below, pair)
        both = _columns(below, drive, position, structure, smooth.delay)
        if record.pieces:
            free = free_start(below, i, base.filter, record.pieces)
            both = started_apart(both, free, record.pieces, len(base.filter) - 1)
        else:
            both = both[len(base.filter) + structure.zeros + smooth.delay :]
        tried += _numerators(both, below, structure, smooth.delay)
    _, below, above, delay = min(tried, key=lambda one: one[0])
    return AxisModel(below[1:], above, i, delay, record.dt)


def _ahead(signal: Float[np.ndarray, " T"], samples: int) -> np.ndarray:
    """The signal earlier by some samples: it acts without the delay of the command."""
    return np.concatenate([signal[samples:], np.full(samples, signal[-1])])


def _pairs() -> Iterator[Float[np.ndarray, " 3"]]:
    """Denominators of the grid."""
    for w in FREQUENCIES:
        for zeta in DAMPINGS:
            radius = np.exp(-zeta * w)
            yield np.array([1.0, -2 * radius * np.cos(w * np.sqrt(1 - zeta**2)), radius**2])


def _columns(
    below: np.ndarray,
    drive: np.ndarray,
    position: np.ndarray,
    structure: Structure,
    most_delay: int,
) -> np.ndarray:
    """Answers later by a sample each, powers of the time, and last the position."""
    answer = np.asarray(lfilter([1.0], below, drive))
    time = np.linspace(-1, 1, len(drive))
    columns = [shifted(answer, k) for k in range(1, structure.zeros + most_delay + 1)]
    columns += [time**k for k in range(structure.integrators + 1)]
    return np.stack([*columns, position], axis=1)


def _numerators(
    both: np.ndarray, below: np.ndarray, structure: Structure, most_delay: int
) -> Iterator[tuple[float, np.ndarray, np.ndarray, int]]:
    """Squared residual [m^2], denominator, numerator and delay, for every delay up to one."""
    m, triangle = structure.zeros, triangle_of(both)
    last = list(range(m + most_delay, both.shape[1] - 1))
    for delay in range(most_delay + 1):
        chosen = triangle[:, [*range(delay, delay + m), *last]]
        found = solved(chosen, triangle[:, -1])
        left = triangle[:, -1] - chosen @ found
        yield float(left @ left), below, found[:m], delay
