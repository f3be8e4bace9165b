"""The simplest models of an axis, for records that show no more.

A drive that follows its command, y = (b_1 q^-1 + b_2 q^-2) (q^-d u - f sign(v)) / (1 - a q^-1) + p,
with gains of one sign: a gain and a delay, or a lag where that leaves less (a > 0), behind the
reversal error of its friction. And a mass with friction that slides,

    m dv/dt + c v + f sign(v) + o = u(t - d dt),

found as robots are (IDIM-IV: Janot, Vandanjon & Gautier, IEEE Trans. Control Systems Technology 22,
2014): least squares of the command over acceleration, speed, its sign and 1, each of them behind
the same smooth kernel, then again with the motion of the simulated model as instruments, which no
noise of the encoder reaches. Both are judged by the speed that they give from the command alone.
Friction that is larger at rest adds f_s 2^-(v / v_s)^2, by least squares beside the others.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls
from scipy.signal import fftconvolve, lfilter

from tuning.identification.linear import validation
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.output_error import (
    TRAINING,
    AxisFit,
    AxisRecord,
    simulated,
    solved,
    with_slopes,
)
from tuning.identification.linear.validation import Estimate

KERNELS = (0.02, 0.04, 0.08, 0.16)  # [s] half width of the kernel
FEWEST = 5  # samples of it
ROUNDS = 8  # of instruments
SETTLED = 1e-4  # relative change of the parameters
BLOCKS = 20  # of the record, whose sums are taken for independent
STILL = 0.1  # part of a kernel at rest: friction is then any force
TELLS = 1.02  # ratio of what two delays leave that tells them apart
TELLS_SIGN = 0.5  # of the variance of a command, left by a mass with friction that tells its sign
MOVES = 1e-4  # of the response, to which long moves show it
SLOWEST = 0.05  # longest time constant of a lag, of the record
LAGS, FINER = 7, 7  # time constants of a grid; grids, each a third as wide on a scale of ratios
INERT = 10.0  # time constant over the length of a record that shows no viscous friction
STRIBECK = np.geomspace(2e-3 * 2**0.5, 32e-3, 8)  # [m/s] at which half of what is more is left
SEES = 0.04  # [s] half width of the kernel behind which it is looked for
SURE = 5.0  # deviations of what is found


@dataclass(frozen=True)
class Judged:
    """A model on a record."""

    record: AxisRecord  # with the signs of friction, where the model has it
    fit: AxisFit  # on the whole record
    # position from the command alone over the rest, which it was not told from [m]
    output: Float[np.ndarray, " R"]
    explained: float  # part of the variance of the speed there


@dataclass(frozen=True)
class Simple(Judged):
    """A simple model of an axis."""

    estimate: Estimate  # of its coefficients, by blocks of the record
    stribeck: tuple[float, float] | None = None  # f_s [command], v_s [m/s]; None where not sure
    ripple: float = 0.0  # amplitude of a slow force that nothing of it explains [command]


def simplest(record: AxisRecord, resolution: float, most_delay: int) -> Simple | None:
    """The simple model that explains the most of what it was not fitted to; None without any.

    Args:
        record: of the axis, without drags.
        resolution: of its encoder [m].
        most_delay: largest delay [samples].
    """
    found = [_follows(record, resolution, most_delay), _slides(record, resolution, most_delay)]
    return max(
        (one for one in found if one is not None), key=lambda one: one.explained, default=None
    )


def _follows(record: AxisRecord, resolution: float, most_delay: int) -> Simple | None:
    record = replace(record, drags=(validation.speed_signs(record.position, resolution),))
    cut = int(TRAINING * len(record.position))
    model = _gain_and_lag(record.part(0, cut), most_delay)
    if model is None:
        return None
    found = judged(record, model, reversal_error(record.part(0, cut), model))
    return Simple(*vars(found).values(), validation.estimate_of(found.fit))


def reversal_error(record: AxisRecord, model: AxisModel) -> Float[np.ndarray, " 1"]:
    """Friction of a drive that holds its place, by least squares of what a model leaves of it.

    Zero where it would not brake. The record has the sign of the speed as its drag.
    """
    bare, moves = simulated(record, model), record.drags[0] != 0
    moved = simulated(record, model, drag=np.ones(1)).output - bare.output
    columns = np.stack([moved, np.ones(len(moved))], axis=1)[moves]
    return np.maximum(solved(columns, bare.residual[moves])[:1], 0.0)


def moves_of(
    record: AxisRecord, model: AxisModel, frequency: Float[np.ndarray, " F"]
) -> validation.Response:
    """What the moves show below the lowest line: the model with other gain, lag and inertia.

        y = (1 + g + t d/dt + a d^2/dt^2) G u - f sign(v) + p
    by least squares, where the axis moves. The record has the sign of the speed as its drag.
    """
    bare, moves = simulated(record, model), record.drags[0] != 0
    moved = simulated(record, model, drag=np.ones(1)).output - bare.output
    answer = bare.output - bare.output.mean()
    speed = np.gradient(answer, record.dt)
    columns = [answer, speed, np.gradient(speed, record.dt), moved, np.ones(len(moved))]
    gain, lag, inertia, *_ = solved(np.stack(columns, axis=1)[moves], bare.residual[moves])
    s = 2j * np.pi * frequency
    factor = 1 + gain + lag * s + inertia * s**2
    width = np.full(len(frequency), 2 * MOVES)
    return validation.Response(frequency, model.response(2 * np.pi * frequency) * factor, width)


def judged(
    record: AxisRecord, model: AxisModel, drag: Float[np.ndarray, " s"] | None = None
) -> Judged:
    """A fixed model on a record; nothing but the motion before it is fitted."""
    rest = record.part(int(TRAINING * len(record.position)), len(record.position))
    output = simulated(rest, model, drag=drag).output
    explained = part_explained(rest.position, output)
    return Judged(record, with_slopes(record, model, drag), output, explained)


def part_explained(position: Float[np.ndarray, " T"], output: Float[np.ndarray, " T"]) -> float:
    """Part of the variance of the speed that a simulated position explains; 0 where none moves."""

    def speed(signal: np.ndarray) -> np.ndarray:
        return signal[validation.WINDOW :] - signal[: -validation.WINDOW]

    variance = float(np.var(speed(position)))
    return 1 - float(np.var(speed(position - output))) / variance if variance > 0 else 0.0


def _gain_and_lag(record: AxisRecord, most_delay: int) -> AxisModel | None:
    """Gains of one sign and the delay that leave the least of the position, behind a lag if any.

    The pole of the lag is looked for on grids of its time constant, each around the last one's.
    """
    u, y = record.command - record.command[0], record.position - record.position.mean()
    sign = float(np.sign(u @ y)) or 1.0
    brakes = np.append(0.0, record.drags[0][:-1])

    def best(pole: float) -> tuple[float, int, np.ndarray]:
        drive, held = (np.asarray(lfilter([1.0], [1.0, -pole], one)) for one in (sign * u, brakes))
        held = held - held.mean()
        found = []
        for delay in range(most_delay + 1):
            columns = [np.append(np.zeros(k), drive[:-k]) for k in (delay + 1, delay + 2)]
            columns = np.stack([*(one - one.mean() for one in columns), held], axis=1)
            gains, left = nnls(columns, y)
            found.append((left, delay, sign * gains[:2]))
        return min(found, key=lambda one: one[0])

    constants = np.geomspace(record.dt, SLOWEST * len(y) * record.dt, LAGS)
    gain, tried = best(0.0), []
    for _ in range(FINER):
        tried += [(*best(pole), pole) for pole in np.exp(-record.dt / constants)]
        least = -record.dt / np.log(min(tried, key=lambda one: one[0])[3])
        ratio = constants[1] / constants[0]
        constants = np.geomspace(least / ratio, least * ratio, LAGS)
    lag = min(tried, key=lambda one: one[0])
    left, delay, gains, *poles = lag if lag[0] * TELLS < gain[0] else gain
    return AxisModel(-np.array(poles), gains, 0, delay, record.dt) if gains.any() else None


@dataclass(frozen=True)
class _Sliding:
    """Parameters m, c, f, o of a mass with friction, their covariance, and a delay [samples]."""

    values: Float[np.ndarray, " 4"]
    covariance: Float[np.ndarray, "4 4"]
    delay: int

    def model(self, dt: float, values: Float[np.ndarray, " 4"] | None = None) -> AxisModel:
        """The axis without its friction, of a held command."""
        mass, viscous = (self.values if values is None else values)[:2]
        constant = mass / viscous
        pole = np.exp(-dt / constant)
        lag = constant * (1 - pole)
        numerator = np.array([dt - lag, lag - pole * dt]) / viscous
        return AxisModel(np.array([-pole]), numerator, 1, self.delay, dt)

    def coefficients(self, dt: float, values: Float[np.ndarray, " 4"]) -> Float[np.ndarray, " 5"]:
        """Values a_1, b_1, b_2, friction and offset of an `Estimate`."""
        model = self.model(dt, values)
        return np.concatenate([model.denominator, model.numerator, [values[2], -values[3]]])

    def estimate(self, dt: float) -> Estimate:
        """Coefficients of the model, with their covariance to first order."""
        steps = 1e-4 * np.abs(self.values) + 1e-300
        slopes = [
            (self.coefficients(dt, self.values + step) - self.coefficients(dt, self.values - step))
            / (2 * step.max())
            for step in np.diag(steps)
        ]
        J = np.stack(slopes, axis=1)
        names = ("a1", "b1", "b2", *validation.DRAGS)
        return Estimate(names, self.coefficients(dt, self.values), J @ self.covariance @ J.T)


def _slides(record: AxisRecord, resolution: float, most_delay: int) -> Simple | None:
    cut = int(TRAINING * len(record.position))
    training, rest = record.part(0, cut), record.part(cut, len(record.position))
    tried = list(_slidings(training, resolution, most_delay))
    if not tried:
        return None
    half, best = max(tried, key=lambda one: _explained(training, one[1]))
    signs = validation.speed_signs(record.position, resolution)
    whole = _sliding(record, signs, half, most_delay)
    left = [1 - _explained(record, one) for one in (whole or best, best)]
    whole = best if whole is None or left[0] > TELLS * left[1] else whole
    output = _moved(rest, best)[0]
    stribeck, ripple = _at_low_speed(record, signs, whole)
    if stribeck is not None:
        whole = replace(whole, values=np.where(np.arange(4) == 2, stribeck[0], whole.values))
    explained = part_explained(rest.position, output)
    dragged = replace(record, drags=(signs, np.ones(len(signs))))
    drag = np.array([whole.values[2], -whole.values[3]])
    fit = with_slopes(dragged, whole.model(record.dt), drag)
    more = None if stribeck is None else stribeck[1:]
    return Simple(dragged, fit, output, explained, whole.estimate(record.dt), more, ripple)


def is_reversed(record: AxisRecord, resolution: float) -> bool:
    """Whether mass, drag and friction that explain a command are all negative."""
    rates = _kernel(max(round(KERNELS[-1] / record.dt), FEWEST), record.dt)
    if 2 * len(rates[0]) > len(record.position):
        return False
    signs = validation.speed_signs(record.position, resolution)
    A = _regressors(record.position, -signs, rates)
    force = fftconvolve(record.command, rates[0], "valid")
    values, *_ = np.linalg.lstsq(A, force, rcond=None)
    return bool((values[:3] < 0).all() and np.var(force - A @ values) < TELLS_SIGN * np.var(force))


def _at_low_speed(
    record: AxisRecord, signs: Float[np.ndarray, " T"], one: _Sliding
) -> tuple[tuple[float, float, float] | None, float]:
    """Friction that slides, what is more at rest, the speed at which half of that is left; ripple.

    The ripple is that of a sine with the variance of the force that is left, as of cogging.
    """
    rates = _kernel(max(round(SEES / record.dt), FEWEST), record.dt)
    if 2 * len(rates[0]) > len(signs):
        return None, 0.0
    moves = fftconvolve((signs == 0).astype(float), rates[0], "valid") < STILL
    speed = fftconvolve(record.position, rates[1], "same")
    force = fftconvolve(_held(record, one.delay), rates[0], "valid")[moves]
    A = _regressors(record.position, -signs, rates)[moves]
    if len(A) < BLOCKS * (A.shape[1] + 1):
        return None, 0.0
    ripple = float(np.sqrt(2 * np.var(force - A @ np.linalg.lstsq(A, force, rcond=None)[0])))
    found = []
    for v_s in STRIBECK:
        more = fftconvolve(-signs * 0.5 ** ((speed / v_s) ** 2), rates[0], "valid")[moves]
        columns = np.column_stack([A, more])
        values, *_ = np.linalg.lstsq(columns, force, rcond=None)
        left = force - columns @ values
        if values[-1] < one.values[2]:  # at the lowest speeds few samples bound it
            found.append((float(np.var(left)), float(v_s), values, columns, left))
    if not found:
        return None, ripple
    variance, v_s, values, columns, left = min(found, key=lambda each: each[0])
    blocks = np.array_split(columns * left[:, None], BLOCKS)
    sums = np.stack([block.sum(axis=0) for block in blocks])
    inverse = np.linalg.pinv(columns.T @ columns)
    deviation = np.sqrt((inverse @ (sums.T @ sums) @ inverse.T)[-1, -1])
    inside = STRIBECK[0] < v_s < STRIBECK[-1]  # else it is a part of the friction, or of the drag
    sure = inside and values[-1] > SURE * deviation
    if not sure:
        return None, ripple
    return (float(values[2]), float(values[-1]), v_s), float(np.sqrt(2 * variance))


def _slidings(
    record: AxisRecord, resolution: float, most_delay: int
) -> Iterator[tuple[int, _Sliding]]:
    """What kernels of different widths [samples] show."""
    signs = validation.speed_signs(record.position, resolution)
    halves = {max(round(width / record.dt), FEWEST) for width in KERNELS}
    for half in sorted(halves):
        if 4 * half < len(record.position):
            found = _sliding(record, signs, half, most_delay)
            if found is not None:
                yield half, found


def _sliding(
    record: AxisRecord, signs: Float[np.ndarray, " T"], half: int, most_delay: int
) -> _Sliding | None:
    """Parameters behind one kernel; None where they are those of no machine."""
    rates = _kernel(half, record.dt)
    moves = fftconvolve((signs == 0).astype(float), rates[0], "valid") < STILL
    A = _regressors(record.position, -signs, rates)[moves]
    if len(A) < BLOCKS * A.shape[1]:
        return None
    found = []
    for delay in range(most_delay + 1):  # the first of equals is taken
        force = fftconvolve(_held(record, delay), rates[0], "valid")[moves]
        values, *_ = np.linalg.lstsq(A, force, rcond=None)
        found.append((float(np.var(force - A @ values)), delay, force, values))
    least = min(found, key=lambda one: one[0])[0]
    delay, force, values = next(one[1:] for one in found if one[0] <= TELLS * least)
    one = _Sliding(_possible(values, record), np.zeros((4, 4)), delay)
    for _ in range(ROUNDS):
        if not one.values[0] > 0:
            return None
        position, speed = _moved(record, one)
        if not np.isfinite(position).all():
            return None
        Z = _regressors(position, np.sign(speed), rates)[moves]
        try:
            inverse = np.linalg.inv(Z.T @ A)
        except np.linalg.LinAlgError:
            return None
        before, values = one.values, _possible(inverse @ Z.T @ force, record)
        blocks = np.array_split(Z * (force - A @ values)[:, None], BLOCKS)
        sums = np.stack([block.sum(axis=0) for block in blocks])
        one = _Sliding(values, inverse @ (sums.T @ sums) @ inverse.T, delay)
        if np.abs(values - before).max() < SETTLED * np.abs(values).max():
            break
    return one if one.values[0] > 0 else None


def _kernel(half: int, dt: float) -> list[Float[np.ndarray, " _"]]:
    """A smooth kernel and its first two derivatives."""
    c, s = (fun(np.pi / 2 * np.arange(-half, half + 1) / (half + 1)) for fun in (np.cos, np.sin))
    per_second = np.pi / 2 / ((half + 1) * dt)
    slope, bend = -4 * per_second * c**3 * s, 4 * per_second**2 * (3 * c**2 * s**2 - c**4)
    return [one / np.sum(c**4) for one in (c**4, slope, bend)]


def _regressors(position: np.ndarray, sign: np.ndarray, rates: list) -> np.ndarray:
    parts = (position, rates[2]), (position, rates[1]), (sign, rates[0])
    columns = [fftconvolve(signal, one, "valid") for signal, one in parts]
    return np.stack([*columns, np.ones(len(columns[0]))], axis=1)


def _held(record: AxisRecord, delay: int) -> Float[np.ndarray, " T"]:
    """The command, late and held over a sample."""
    held = (record.command + np.append(record.command[:1], record.command[:-1])) / 2
    return np.append(np.full(delay, held[0]), held)[: len(held)]


def _possible(values: Float[np.ndarray, " 4"], record: AxisRecord) -> Float[np.ndarray, " 4"]:
    """The parameters with friction that brakes, if hardly, and a mass that takes a sample at least.

    A record of steady speeds shows no mass.
    """
    mass, viscous, friction, offset = values
    viscous = max(viscous, abs(mass) / (INERT * record.dt * len(record.position)))
    return np.array([max(mass, viscous * record.dt), viscous, max(friction, 0.0), offset])


def _explained(record: AxisRecord, one: _Sliding) -> float:
    return part_explained(record.position, _moved(record, one)[0])


def _moved(
    record: AxisRecord, one: _Sliding
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Position [m] and speed [m/s] from the command alone, and the place where a record begins.

    Between samples force and direction are held, the rest is exact; at rest the axis sticks until
    the force is larger than its friction.
    """
    _, viscous, friction, offset = one.values.tolist()
    pole = -one.model(record.dt).denominator.item()
    lag = (1 - pole) * one.values[0] / viscous
    late = np.append(np.full(one.delay, record.command[0]), record.command)
    x = float(record.position[0])
    ahead = min(validation.WINDOW, len(record.position) - 1)
    v = float(record.position[ahead] - x) / (ahead * record.dt)
    places, speeds = [], []
    for force in (late[: len(record.command)] - offset).tolist():
        places.append(x)
        speeds.append(v)
        if v == 0.0 and abs(force) <= friction:
            continue
        way = np.sign(v) or np.sign(force)
        steady = (force - friction * way) / viscous
        after = steady + (v - steady) * pole
        if way * after < 0:
            v = 0.0
            continue
        x += (v - steady) * lag + steady * record.dt
        v = after
    return np.array(places), np.array(speeds)
