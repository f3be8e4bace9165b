"""Responses of least peak: the smallest error that any policy of a given length can promise.

The policy with the responses X, U of `finite_responses` keeps |c x + d u| below the peak of that
signal, whatever the disturbances of the box do. The responses of least peak are the optimum of a
linear program: the finite form of system level synthesis (Anderson, Doyle, Low & Matni 2019) with
the peaks of l1 optimal control (Dahleh & Pearson 1987) as its cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import OptimizeResult

from jcontour.sets.disturbed_model import DisturbedModel, Numbers, Signal
from jcontour.sets.finite_responses import FiniteResponse, brought_to_rest
from jcontour.sets.peak_program import PeakProgram

EXCESS = 1e-7  # relative, of a limit, that counts as broken


@dataclass(frozen=True)
class LeastPeak:
    """Optimum of the linear program.

    Attributes:
        response: one of the optimal responses; the tolerance is unique, the responses are not.
        tolerance: the smallest largest peak of the signals that are made small.
        peaks: peak of every signal by name.
        limiting: names of the signals whose limits keep the tolerance from being smaller.
    """

    response: FiniteResponse
    tolerance: float
    peaks: dict[str, float]
    limiting: tuple[str, ...]


class NoResponse(ValueError):
    """No response of this length respects the limits.

    Attributes:
        limiting: names of the signals whose limits are too small; empty where no response comes to
            rest at all, and where the linear program's numbers are of too different sizes.
        needed: the smallest magnitudes of all these together, by name.
        asked: their limits, by name.
    """

    def __init__(self, message: str, needed: dict[str, float], asked: dict[str, float]):
        self.needed, self.asked = needed, asked
        self.limiting = tuple(needed)
        super().__init__(message)


def least_peak(
    model: DisturbedModel,
    small: Sequence[Signal],
    limited: Sequence[Signal],
    length: int,
    vanishing: Numbers | None = None,
) -> LeastPeak:
    """Responses whose largest peak is the least, under limits on the peaks of other signals.

    A slide of 1 kg, pushed by at most 1 N of 4 N that its drive has, sampled every 10 ms:

    >>> dt = 1e-2
    >>> slide = DisturbedModel.of([[1, dt], [0, 1]], [dt**2 / 2, dt], [dt**2 / 2, dt])
    >>> position = slide.state_signals(["position"], [1, 0])
    >>> found = least_peak(slide, position, slide.control_signals(4.0), length=10)
    >>> f"{1e3 * found.tolerance:.3f} mm", found.limiting
    ('0.100 mm', ())

    Args:
        model: matrices A, B, E.
        small: signals whose largest peak is made small, all in one unit; a limit on one holds too.
        limited: signals with a limit.
        length: samples N after which the answer to a disturbance has come to rest.
        vanishing: rows C (m, n) with sum_j C X_j = 0: a constant disturbance leaves no error in
            them.

    Raises:
        NoResponse: no response of this length respects the limits; it names what is too small.
        ValueError: nothing is made small, a length below one, or a limit that is not above zero.
    """
    _check(model, small, limited, length)
    still = _vanishing(model, vanishing)
    program = PeakProgram(model, [*small, *limited], len(small), length, still)
    rough, sizes = _rough(program)
    # every state and the optimum itself are scaled to one: the solver's tolerances are absolute
    scales = _scales(program, rough, sizes)
    size = max(float(rough.x[program.optimum]), np.finfo(float).tiny ** 0.25)
    fine = program.solved(scales, size)
    if fine is None:
        fine, scales, size = rough, sizes, 1.0
    _, controls = program.responses(fine, scales)
    response = brought_to_rest(model, controls, still)
    peaks = {signal.name: response.peak(signal) for signal in [*small, *limited]}
    tolerance = max(peaks[signal.name] for signal in small)
    return LeastPeak(response, tolerance, peaks, program.limiting(fine))


def _rough(program: PeakProgram) -> tuple[OptimizeResult, Float[np.ndarray, " n"]]:
    """First optimum and its scales of the states, by which the solver finds an answer.

    Tried are states of one, those of the largest push of a disturbance, and those of a response
    that keeps the limits, which is found even where the numbers are of very different sizes.
    """
    sizes = np.abs(program.model.E).max(axis=1)
    sizes = np.where(sizes > 0, sizes, 1.0)
    for scales in (np.ones(program.model.states), sizes):
        if found := program.solved(scales, 1.0):
            return found, scales
    keeping = program.solved(sizes, 1.0, soft=True) if program.bounded else None
    if keeping is not None and program.excess(keeping).max() <= EXCESS:
        scales = _scales(program, keeping, sizes)
        if found := program.solved(scales, 1.0):
            return found, scales
    raise _impossible(program, keeping, sizes)


def _scales(
    program: PeakProgram, found: OptimizeResult, sizes: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Largest state of a response, one where it is always zero."""
    states, _ = program.responses(found, sizes)
    largest = np.abs(states).max(axis=(0, 2))
    return np.where(largest > 0, largest, 1.0)


def _impossible(
    program: PeakProgram, found: OptimizeResult | None, sizes: Float[np.ndarray, " n"]
) -> NoResponse:
    """The exception, with the limits that are too small in the response of least excess."""
    N = program.length
    if found is None:
        return NoResponse(
            f"length: no response of {N} samples comes to rest; a longer one may, "
            "if the controls reach every state",
            {},
            {},
        )
    needed = {
        signal.name: signal.limit * (1 + float(excess))
        for signal, excess in zip(program.bounded, program.excess(found), strict=True)
        if excess > EXCESS
    }
    if not needed:
        columns = (np.abs(program.model.E) / sizes[:, None]).max(axis=0)
        ratio = columns.max() / columns[columns > 0].min() if columns.any() else 1.0
        return NoResponse(
            f"model: the limits leave room for a response of {N} samples, but the linear program "
            "has no answer with them; its numbers are of too different sizes, columns of E by a "
            f"factor of {ratio:.3g}",
            {},
            {},
        )
    limits = {one.name: one.limit for one in program.bounded if one.name in needed}
    told = [
        f"{name} at most {limits[name]:.6g}, {least:.6g} would do" for name, least in needed.items()
    ]
    message = f"limits: no response of {N} samples keeps them: {'; '.join(told)}"
    return NoResponse(message, needed, limits)


def _check(
    model: DisturbedModel, small: Sequence[Signal], limited: Sequence[Signal], length: int
) -> None:
    if not small:
        raise ValueError("small: needs at least one signal to make small")
    if length < 1:
        raise ValueError(f"length: needs at least one sample, received {length}")
    names = [signal.name for signal in [*small, *limited]]
    if len(set(names)) < len(names):
        raise ValueError(f"signals: every name may be there once, received {', '.join(names)}")
    for signal in [*small, *limited]:
        shapes = np.shape(signal.state), np.shape(signal.control)
        if shapes != ((model.states,), (model.inputs,)):
            needed = f"({model.states},) and ({model.inputs},)"
            raise ValueError(f"{signal.name}: needs rows of shape {needed}, received {shapes}")
        if not signal.limit > 0:
            raise ValueError(f"{signal.name}: needs a limit above zero, received {signal.limit}")


def _vanishing(model: DisturbedModel, rows: Numbers | None) -> Float[np.ndarray, "m n"]:
    if rows is None:
        return np.zeros((0, model.states))
    found = np.atleast_2d(np.asarray(rows, float))
    if found.ndim != 2 or found.shape[1] != model.states or not np.isfinite(found).all():
        raise ValueError(
            f"vanishing: needs finite numbers of shape (m, {model.states}), received {found.shape}"
        )
    return found
