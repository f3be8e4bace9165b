"""One axis model on a record: what it answers, what it leaves, and how that changes with it.

The position is the command's answer, the motion from before the record and what no command brings:

    y = (B/A) U + (1/A) sum_j c_j q^-j delta + p_0 + p_1 k + ... + p_i k^i + (B/A) f S + r

U is the command behind its delay and integrators, delta the unit pulse at the first sample that no
command from before the record reaches directly, p the place where the axis stands and what an
offset of its command adds up to, S what acts where the command arrives, as the sign of the speed
does for Coulomb friction: behind the integrators, without the command's delay. c and p are those
of least squares behind the noise filter W of `whitening`. The slopes are

    dy/da_i = -q^-i (y_dynamic / A),      dy/db_i = q^-i (U / A) (+ f S / A)
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel

TRAINING = 0.7  # of a record: what a model is told from; the rest judges it
NOISE_TERMS = 200  # of the noise filter at most: counts on top of a drift have a long memory
WHITE: Float[np.ndarray, " 1"] = np.ones(1)
FEWEST = 10  # samples for each coefficient
RIDGE = 1e-12  # of a column's squares: a residual of few tones has a filter too


@dataclass(frozen=True)
class AxisRecord:
    """Command and position of one axis."""

    dt: float  # sample period [s]
    command: Float[np.ndarray, " T"]  # [command unit], held over each sample
    position: Float[np.ndarray, " T"]  # [m]
    # signals S that act where the command arrives, without its delay, as the sign of the speed does
    drags: tuple[Float[np.ndarray, " T"], ...] = ()

    def part(self, start: int, end: int) -> "AxisRecord":
        """Samples start..end."""
        drags = tuple(one[start:end] for one in self.drags)
        return AxisRecord(self.dt, self.command[start:end], self.position[start:end], drags)


@dataclass(frozen=True)
class Structure:
    """What a model has room for."""

    poles: int  # n beside the integrators
    zeros: int  # m coefficients of the numerator
    integrators: int  # i
    delay: int  # d [samples]


@dataclass(frozen=True)
class _Trial:
    """A model on a record, and all that Gauss-Newton asks of it."""

    # model, drag, linear, errors, jacobian: as in `AxisFit`
    model: AxisModel
    drag: np.ndarray
    answer: np.ndarray  # of the model to the command and the drags (T,) [m]
    before: np.ndarray  # columns of what no command of the record brings (T, l)
    begin: int  # sample from which commands before the record act no more
    linear: np.ndarray
    errors: np.ndarray
    jacobian: np.ndarray


@dataclass(frozen=True)
class AxisFit:
    """A model with what it leaves."""

    model: AxisModel  # of the axis
    drag: Float[np.ndarray, " s"]  # f, how much of every drag there is [command unit]
    linear: Float[np.ndarray, " l"]  # c, p [m]: the motion before the record
    filter: Float[np.ndarray, " w"]  # W, under which it was fitted
    output: Float[np.ndarray, " T"]  # what the model says (T,) [m]
    # position - output [m]; zero while commands from before the record still act
    residual: Float[np.ndarray, " T"]
    errors: Float[np.ndarray, " R"]  # the residual behind W, without its first rows
    jacobian: Float[np.ndarray, "R p"]  # slopes of the errors over (a, b, f, c, p)
    rows: Int[np.ndarray, " R"]  # samples that the errors belong to

    @property
    def loss(self) -> float:
        """Mean square of the errors [m^2]."""
        return float(np.mean(self.errors**2))


def with_slopes(
    record: AxisRecord,
    model: AxisModel,
    drag: Float[np.ndarray, " s"] | None = None,
    filter_: Float[np.ndarray, " w"] | None = None,
) -> AxisFit:
    """A fixed model on a record, with slopes; the noise filter of what it leaves if none is given.

    Args:
        record: of the axis.
        model: of the axis.
        drag: f, how much of every drag there is; none when not given.
        filter_: W.
    """
    if filter_ is None:
        filter_ = whitening(simulated(record, model, drag=drag).residual, NOISE_TERMS)
    trial = _evaluated(record, structure_of(model), filter_, model, drag)
    return _finished(record, filter_, trial)


def structure_of(model: AxisModel) -> Structure:
    """Structure that a model has."""
    return Structure(len(model.denominator), len(model.numerator), model.integrators, model.delay)


def simulated(
    record: AxisRecord,
    model: AxisModel,
    filter_: Float[np.ndarray, " w"] = WHITE,
    drag: Float[np.ndarray, " s"] | None = None,
) -> AxisFit:
    """Any model on a record, without a fit but of the motion before it."""
    trial = _evaluated(record, structure_of(model), filter_, model, drag, slopes=False)
    return _finished(record, filter_, trial)


def _evaluated(
    record: AxisRecord,
    structure: Structure,
    filter_: np.ndarray,
    model: AxisModel,
    drag: np.ndarray | None,
    slopes: bool = True,
) -> _Trial:
    """Model on a record: the motion before it by least squares, then errors and slopes."""
    below = np.concatenate([[1.0], model.denominator])
    above = np.concatenate([[0.0], model.numerator])
    drag = np.zeros(len(record.drags)) if drag is None else drag
    drive = _filtered(below, driven(record.command, structure))
    # drags are behind the integrators: they do not wait for the command's delay
    dragged = [driven(one, replace(structure, delay=0)) for one in record.drags]
    drags = [_filtered(below, one) for one in dragged]
    drive = drive + sum(f * one for f, one in zip(drag, drags, strict=True))
    answer = whitened(drive, above)
    begin = structure.zeros + model.delay  # what commands before the record still bring is over
    first = begin + len(filter_) - 1
    free, grown = _before(below, structure, len(drive), begin)
    seen = _side_by_side(
        whitened(free, filter_), [whitened(one, filter_) for one in grown], structure
    )
    seen = seen[first:]
    missed = whitened(record.position - record.position[0] - answer, filter_)[first:]
    before = _side_by_side(free, grown, structure)
    linear = solved(seen, missed)
    errors = missed - seen @ linear
    jacobian = np.zeros((len(errors), 0))
    if slopes:
        own = answer + before[:, : structure.poles] @ linear[: structure.poles]
        back, drive = whitened(_filtered(below, own), filter_), whitened(drive, filter_)
        parts = [shifted(back, i)[first:] for i in range(1, structure.poles + 1)]
        parts += [-shifted(drive, i)[first:] for i in range(1, structure.zeros + 1)]
        parts += [-whitened(whitened(one, above), filter_)[first:] for one in drags]
        jacobian = np.concatenate([np.stack(parts, axis=1), -seen], axis=1)
    return _Trial(model, drag, answer, before, begin, linear, errors, jacobian)


def _finished(record: AxisRecord, filter_: np.ndarray, trial: _Trial) -> AxisFit:
    """The model with what it leaves of the position, the motion before the record fitted to it."""
    before, begin = trial.before, trial.begin
    left = record.position - record.position[0] - trial.answer
    rows = np.arange(len(left) - len(trial.errors), len(left))
    residual = left - before @ solved(before[begin:], left[begin:])
    residual[:begin] = 0.0
    return AxisFit(
        trial.model,
        trial.drag,
        trial.linear,
        filter_,
        record.position - residual,
        residual,
        trial.errors,
        trial.jacobian,
        rows,
    )


def _before(
    below: np.ndarray, structure: Structure, rows: int, begin: int
) -> tuple[np.ndarray, list[np.ndarray]]:
    """What no command of the record brings: a pulse behind 1 / A, and powers of the time."""
    pulse = np.zeros(rows)
    pulse[begin] = 1.0
    time = np.linspace(-1, 1, rows)
    return _filtered(below, pulse), [time**j for j in range(structure.integrators + 1)]


def _side_by_side(free: np.ndarray, grown: list[np.ndarray], structure: Structure) -> np.ndarray:
    """Columns: the pulse's answer, once for every pole and each a sample later, and the powers."""
    return np.stack([*(shifted(free, j) for j in range(structure.poles)), *grown], axis=1)


def driven(command: Float[np.ndarray, " T"], structure: Structure) -> Float[np.ndarray, " T"]:
    """The command behind its delay and integrators; it held its first value before the record."""
    signal = command - command[0] if structure.integrators == 0 else command
    signal = np.concatenate([np.full(structure.delay, signal[0]), signal])[: len(command)]
    for _ in range(structure.integrators):
        signal = np.cumsum(signal)
    return signal


def shifted(signal: Float[np.ndarray, " T"], samples: int) -> Float[np.ndarray, " T"]:
    """The signal later by some samples, zero before."""
    return np.concatenate([np.zeros(samples), signal[: len(signal) - samples]])


def _filtered(below: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """The signal behind 1 / A."""
    return np.asarray(lfilter([1.0], below, signal))


def solved(columns: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Least squares over columns of any size; a column of zeros gets zero."""
    scale = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    scale = np.where(scale > 0, scale, 1.0)
    both = triangle_of(np.concatenate([columns / scale, right[:, None]], axis=1))
    found, *_ = np.linalg.lstsq(both[:, :-1], both[:, -1], rcond=1e-14)
    return found / scale


def whitening(residual: Float[np.ndarray, " T"], most: int) -> Float[np.ndarray, " w"]:
    """Filter 1, w_1, ..., w_p that makes a residual white; p of at most `most` by Akaike's number.

        r(k) + w_1 r(k-1) + ... + w_p r(k-p) = e(k),   e white
    Behind this filter a fit weighs what is known well more, and its errors are what the command of
    a closed loop cannot have caused: with it, records under feedback give no bias (Ljung, System
    Identification, 2nd ed., section 13.4), without it they do.

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


BLOCK = 400  # rows: with eight columns 26 kB


def triangle_of(columns: Float[np.ndarray, "T p"]) -> Float[np.ndarray, "r p"]:
    """R of columns = Q R, upper triangular; r is the smaller of T and p.

    Blocks of rows that fit a processor's cache are factored by themselves, then their triangles
    together (Demmel, Grigori, Hoemmen and Langou, SIAM J. Sci. Comput. 34, 2012): as exact as in
    one piece, several times as fast.
    """
    rows, p = columns.shape
    whole = rows // BLOCK
    if p == 0 or 4 * p > BLOCK or whole < 2:
        return np.asarray(np.linalg.qr(columns, mode="r"))
    blocks = columns[: whole * BLOCK].reshape(whole, BLOCK, p)
    triangles = np.asarray(np.linalg.qr(blocks, mode="r")).reshape(-1, p)
    return triangle_of(np.concatenate([triangles, columns[whole * BLOCK :]]))
