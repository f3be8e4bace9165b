"""Least-squares fit of one axis model to a record.

The position is the command's answer, the motion from before the record and what no command brings:

    y = (B/A) U + (1/A) sum_j c_j q^-j delta + p_0 + p_1 k + ... + p_i k^i + (B/A) f S + r

U is the command behind its delay and integrators, delta the unit pulse at the first sample that no
command from before the record reaches directly, p the place where the axis stands and what an
offset of its command adds up to, S what acts where the command arrives, as the sign of the speed
does for Coulomb friction: behind the integrators, without the command's delay. The fit minimises
sum (W r)^2 with W of `noise_model`: it is started by Steiglitz and McBride's iteration (IEEE Trans.
Automatic Control 10, 1965) and ended by Gauss-Newton, whose slopes are the same few signals
filtered once more and shifted:

    dy/da_i = -q^-i (y_dynamic / A),      dy/db_i = q^-i (U / A) (+ f S / A)
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.signal import lfilter

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.noise_model import WHITE, whitened
from tuning.identification.linear.pieces import (
    Pieces,
    free_start,
    of_starts,
    rows_of,
    started_apart,
)
from tuning.identification.linear.triangles import triangle_of

ITERATIONS, HALVINGS = 40, 12
SETTLED = 1e-10  # relative change of the loss
START = 20.0  # time constant [samples] of the first prefilter
ROUNDS = 5  # of Steiglitz and McBride
STABLE = 1 - 1e-7  # largest pole


@dataclass(frozen=True)
class AxisRecord:
    """Command and position of one axis.

    Attributes:
        dt: sample period [s].
        command: [command unit], held over each sample.
        position: [m].
        drags: signals S that act where the command arrives, without its delay, as the sign of the
            speed does.
        pieces: in which alone the model is fitted, each from a start of its own; all in one where
            there are none.
    """

    dt: float
    command: Float[np.ndarray, " T"]
    position: Float[np.ndarray, " T"]
    drags: tuple[Float[np.ndarray, " T"], ...] = ()
    pieces: Pieces = Pieces()

    def part(self, start: int, end: int) -> "AxisRecord":
        """Samples start..end."""
        drags = tuple(one[start:end] for one in self.drags)
        pieces = self.pieces.within(start, end)
        return AxisRecord(self.dt, self.command[start:end], self.position[start:end], drags, pieces)


@dataclass(frozen=True)
class Structure:
    """What a model has room for.

    Attributes:
        poles: n beside the integrators.
        zeros: m coefficients of the numerator.
        integrators: i.
        delay: d [samples].
    """

    poles: int
    zeros: int
    integrators: int
    delay: int


@dataclass(frozen=True)
class _Trial:
    """A model on a record, and all that Gauss-Newton asks of it.

    Attributes:
        answer: of the model to the command and the drags (T,) [m].
        before: columns of what no command of the record brings (T, l).
        begin: sample from which commands before the record act no more.
        model, drag, linear, errors, jacobian: as in `AxisFit`.
    """

    model: AxisModel
    drag: np.ndarray
    answer: np.ndarray
    before: np.ndarray
    begin: int
    linear: np.ndarray
    errors: np.ndarray
    jacobian: np.ndarray

    @property
    def loss(self) -> float:
        """Mean square of the errors [m^2]."""
        return float(np.mean(self.errors**2))


@dataclass(frozen=True)
class AxisFit:
    """A model with what it leaves.

    Attributes:
        model: of the axis.
        drag: f, how much of every drag there is [command unit].
        linear: c, p [m]: the motion before the record.
        filter: W, under which it was fitted.
        output: what the model says (T,) [m].
        residual: position - output [m]; zero while commands from before the record still act, and
            between pieces.
        errors: the residual behind W, without its first rows.
        jacobian: slopes of the errors over (a, b, f, c, p); over (a, b, f) in pieces.
        rows: samples that the errors belong to.
        pieces: in which alone it was fitted.
    """

    model: AxisModel
    drag: Float[np.ndarray, " s"]
    linear: Float[np.ndarray, " l"]
    filter: Float[np.ndarray, " w"]
    output: Float[np.ndarray, " T"]
    residual: Float[np.ndarray, " T"]
    errors: Float[np.ndarray, " R"]
    jacobian: Float[np.ndarray, "R p"]
    rows: Int[np.ndarray, " R"]
    pieces: Pieces = Pieces()

    @property
    def loss(self) -> float:
        """Mean square of the errors [m^2]."""
        return float(np.mean(self.errors**2))


def fitted(
    record: AxisRecord,
    structure: Structure,
    filter_: Float[np.ndarray, " w"] = WHITE,
    start: AxisModel | None = None,
    iterations: int = ITERATIONS,
    drag: Float[np.ndarray, " s"] | None = None,
) -> AxisFit:
    """Best model of a structure.

    Args:
        record: of the axis.
        structure: of the model.
        filter_: W.
        start: where to begin; Steiglitz and McBride's model when not given.
        iterations: of Gauss-Newton at most.
        drag: where the search for f begins; at none when not given.

    Raises:
        ValueError: no start led to a stable model.
    """
    first = started(record, structure, filter_) if start is None else start
    return _refined(record, structure, filter_, first, iterations, drag)


def started(
    record: AxisRecord, structure: Structure, filter_: Float[np.ndarray, " w"] = WHITE
) -> AxisModel:
    """Model of Steiglitz and McBride's iteration, a good start and a quick one.

    Raises:
        ValueError: the iteration has no finite end.
    """
    y = whitened(record.position - record.position[0], filter_)
    signals = [driven(record.command, structure), *_dragged(record, structure)]
    inputs = [whitened(one, filter_) for one in signals]
    below = np.atleast_1d(np.poly(np.full(structure.poles, np.exp(-1 / START))))
    numerator = np.full(structure.zeros, np.nan)
    for _ in range(ROUNDS if structure.poles else 1):
        below, numerator = _equation_error(y, inputs, below, structure, filter_, record.pieces)
    if not np.isfinite(numerator).all():
        raise ValueError("no stable model explains the record")
    return AxisModel(below[1:], numerator, structure.integrators, structure.delay, record.dt)


def predicted(
    record: AxisRecord, fit: AxisFit, filter_: Float[np.ndarray, " w"]
) -> Float[np.ndarray, " R"]:
    """Errors behind W of a fixed model on another record [m]; the motion before it is fitted."""
    structure = structure_of(fit.model)
    return _evaluated(record, structure, filter_, fit.model, fit.drag, slopes=False).errors


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


def _equation_error(
    y: np.ndarray,
    inputs: list[np.ndarray],
    below: np.ndarray,
    structure: Structure,
    filter_: np.ndarray,
    pieces: Pieces,
) -> tuple[np.ndarray, np.ndarray]:
    """One least-squares step: A y / A_before = B U / A_before + B_s S / A_before + polynomial."""
    n, m = structure.poles, structure.zeros
    y_ = _filtered(below, y)
    time = np.linspace(-1, 1, len(y))
    columns = [-shifted(y_, i) for i in range(1, n + 1)]
    for one in inputs:
        answer = _filtered(below, one)
        columns += [shifted(answer, i) for i in range(1, m + 1)]
    if pieces:
        both = np.stack([*columns, y_], axis=1)
        free = free_start(below, structure.integrators, filter_, pieces)
        both = started_apart(both, free, pieces, len(filter_) - 1)
        found = solved(both[:, :-1], both[:, -1])
    else:
        columns += [time**i for i in range(structure.integrators + 1)]
        first = len(filter_) + n + m + structure.delay
        found = solved(np.stack(columns, axis=1)[first:], y_[first:])
    return _inside(np.concatenate([[1.0], found[:n]])), found[n : n + m]


def _refined(
    record: AxisRecord,
    structure: Structure,
    filter_: np.ndarray,
    start: AxisModel,
    iterations: int,
    drag: np.ndarray | None,
) -> AxisFit:
    """Gauss-Newton from a start, every step halved until the loss falls."""
    best = _evaluated(record, structure, filter_, start, drag)
    fallen = 0
    for _ in range(iterations):
        tried = _stepped(record, structure, filter_, best)
        if tried is None:
            break
        fallen = fallen + 1 if tried.loss > (1 - SETTLED) * best.loss else 0
        best = tried
        if fallen >= 2:
            break
    return _finished(record, filter_, best)


def _stepped(
    record: AxisRecord, structure: Structure, filter_: np.ndarray, before: _Trial
) -> _Trial | None:
    """A step that is stable and lets the loss fall; None where none does, or would by a trace."""
    n, m = structure.poles, structure.zeros
    step, model = solved(before.jacobian, -before.errors), before.model
    expected = before.jacobian @ step  # the loss falls by its square if the model is linear
    if expected @ expected < SETTLED * (before.errors @ before.errors):
        return None
    for halving in range(HALVINGS):
        part = 0.5**halving * step
        a = model.denominator + part[:n]
        if n > 0 and np.abs(np.roots(np.concatenate([[1.0], a]))).max() >= STABLE:
            continue
        moved = replace(model, denominator=a, numerator=model.numerator + part[n : n + m])
        drag = before.drag + part[n + m : n + m + len(before.drag)]
        tried = _evaluated(record, structure, filter_, moved, drag)
        if tried.loss < before.loss:
            return tried
    return None


def _evaluated(
    record: AxisRecord,
    structure: Structure,
    filter_: np.ndarray,
    model: AxisModel,
    drag: np.ndarray | None,
    slopes: bool = True,
) -> _Trial:
    """Model on a record: the motion before it by least squares, then errors and slopes."""
    if record.pieces:
        return _evaluated_apart(record, structure, filter_, model, drag, slopes)
    below = np.concatenate([[1.0], model.denominator])
    above = np.concatenate([[0.0], model.numerator])
    drag = np.zeros(len(record.drags)) if drag is None else drag
    drive = _filtered(below, driven(record.command, structure))
    drags = [_filtered(below, one) for one in _dragged(record, structure)]
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


def _evaluated_apart(
    record: AxisRecord,
    structure: Structure,
    filter_: np.ndarray,
    model: AxisModel,
    drag: np.ndarray | None,
    slopes: bool,
) -> _Trial:
    """The same in pieces: the start of each by least squares, its slopes after Kaufman."""
    below = np.concatenate([[1.0], model.denominator])
    above = np.concatenate([[0.0], model.numerator])
    n, skip = structure.poles, len(filter_) - 1
    drag = np.zeros(len(record.drags)) if drag is None else drag
    drive = _filtered(below, driven(record.command, structure))
    drags = [_filtered(below, one) for one in _dragged(record, structure)]
    drive = drive + sum(f * one for f, one in zip(drag, drags, strict=True))
    answer = whitened(drive, above)
    left = record.position - record.position[0] - answer
    parts = [whitened(left, filter_)]
    if slopes:
        own = of_starts(left, below, structure.integrators, record.pieces)
        back = whitened(_filtered(below, answer + own), filter_)
        drive = whitened(drive, filter_)
        parts += [shifted(back, i) for i in range(1, n + 1)]
        parts += [-shifted(drive, i) for i in range(1, structure.zeros + 1)]
        parts += [-whitened(whitened(one, above), filter_) for one in drags]
    free = free_start(below, structure.integrators, filter_, record.pieces)
    both = started_apart(np.stack(parts, axis=1), free, record.pieces, skip)
    none = np.zeros((len(left), 0))
    return _Trial(model, drag, answer, none, 0, np.zeros(0), both[:, 0], both[:, 1:])


def _finished(record: AxisRecord, filter_: np.ndarray, trial: _Trial) -> AxisFit:
    """The model with what it leaves of the position, the motion before the record fitted to it."""
    before, begin = trial.before, trial.begin
    left = record.position - record.position[0] - trial.answer
    if record.pieces:
        below = np.concatenate([[1.0], trial.model.denominator])
        starts = of_starts(left, below, trial.model.integrators, record.pieces)
        rows = rows_of(record.pieces, len(filter_) - 1)
        residual = np.zeros(len(left))
        inside = rows_of(record.pieces, 0)
        residual[inside] = (left - starts)[inside]
    else:
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
        record.pieces,
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


def _dragged(record: AxisRecord, structure: Structure) -> list[np.ndarray]:
    """The drags behind the integrators: they do not wait for the command's delay."""
    return [driven(one, replace(structure, delay=0)) for one in record.drags]


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


def _inside(polynomial: np.ndarray) -> np.ndarray:
    """Polynomial with its roots outside the unit circle mirrored into it."""
    roots = np.roots(polynomial)
    far = np.abs(roots) >= STABLE
    if not far.any():
        return polynomial
    mirrored = np.where(far, np.minimum(1 / np.maximum(np.abs(roots), 1e-300), 0.999), 1.0)
    roots = np.where(far, roots / np.maximum(np.abs(roots), 1e-300) * mirrored, roots)
    return np.real(np.poly(roots))
