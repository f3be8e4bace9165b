"""Certificates for every constant gain between bounds, by cells.

The box of gains is cut into cells. The cell with the largest bound is halved across its widest
side: what is between the corners of a cell falls with the square of its width. This ends where it
is next to nothing, or where there are as many cells as asked for. Delays are whole samples, and
each is a loop of its own.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.bounds.certificates import (
    ROUNDING,
    Certificate,
    certificate_of,
    check_box,
    check_limits,
    error_bounds,
)
from jcontour.bounds.distance import frames_along
from jcontour.bounds.disturbed_loop import (
    Box,
    DisturbedLoop,
    UnstableLoop,
    check_stable,
    disturbed_loop,
)
from jcontour.bounds.gains.gain_cells import GainCell, TooWide, cell_peaks
from jcontour.bounds.gains.gained_loops import gained
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import check_kinds

ENOUGH = 0.005  # part of the largest bound between the corners that no more cells are made for


class GainCertificate(NamedTuple):
    """Largest errors for all gains of a box.

    Attributes:
        whole: largest errors and controls over all cells. The rest is that of the gains which come
            closest to the largest bound; so are its attacks.
        gains: these, a corner of a cell.
        cells: that were looked at.
        between: part of the largest bound that is not known to be reached by a corner [m].
    """

    whole: Certificate
    gains: Float[np.ndarray, " p"]
    cells: list[GainCell]
    between: float


class _Bounded(NamedTuple):
    """A cell with its bounds; infinite where its sums do not close, by a factor.

    Attributes:
        at: scored sample of the largest bound.
        largest: this bound [m].
        between: part of it that is between the corners [m].
    """

    cell: GainCell
    bound: np.ndarray
    control: np.ndarray
    at: int
    largest: float
    between: float
    factor: float = 0.0


def gain_certificate(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    box: Box,
    gains: GainCell,
    cells: int = 16,  # two axes of 10 %: the bound is within 2 % of the largest of the members
) -> GainCertificate:
    """Largest errors that a linear loop can have for all constant gains of a box.

    Args:
        plant: at gains of one, as for `certificates.certificate`.
        controller: likewise.
        reference: the run; its scored samples count.
        box: of force and error of the measurement.
        gains: all of them, relative, one interval for each control.
        cells: most cells to cut it into.

    Raises:
        NotAffine: as `certificates.certificate`.
        UnstableLoop: the loop is not stable at a corner of a cell.
        ValueError: likewise, the gains do not fit, a bound is not a number, or cells are too few:
            it is said how many close.
        TypeError: the arguments are swapped, or of another kind.
    """
    check_kinds("gain_certificate", plant=plant, controller=controller, reference=reference)
    loop = disturbed_loop(plant, controller, reference)
    check_box(loop, box)
    _check_gains(gains, loop.control.shape[1], cells)
    found = [_bounded(loop, gains, reference, box)]
    worst = found[0]
    while len(found) < cells and not worst.between <= ENOUGH * worst.largest < np.inf:
        found = [one for one in found if one is not worst]
        found += [_bounded(loop, half, reference, box) for half in worst.cell.halves()]
        worst = max(found, key=lambda one: one.largest)
    _check_closed(found, gains, cells)
    control = np.max([one.control for one in found], axis=0)
    check_limits(plant, controller, control, box)
    members = [
        certificate_of(gained(loop, corner), plant, controller, reference, box)
        for corner in worst.cell.corners
    ]
    closest = int(np.argmax([member.bound[worst.at] for member in members]))
    bound = np.max([one.bound for one in found], axis=0)
    whole = members[closest]._replace(bound=bound, control=control)
    cells_made = [one.cell for one in found]
    return GainCertificate(whole, worst.cell.corners[closest], cells_made, worst.between)


def _check_gains(gains: GainCell, inputs: int, cells: int) -> None:
    if gains.low.shape != (inputs,) or gains.high.shape != (inputs,):
        raise ValueError(
            f"gains: needs an interval for each of {inputs} controls, "
            f"received {gains.low.shape} and {gains.high.shape}"
        )
    if not np.all((gains.low > 0) & (gains.low <= gains.high) & np.isfinite(gains.high)):
        raise ValueError(
            f"gains: needs 0 < low <= high, received {gains.low.tolist()} to {gains.high.tolist()}"
        )
    if cells < 1:
        raise ValueError(f"cells: needs at least one, received {cells}")


def _check_closed(found: list[_Bounded], gains: GainCell, cells: int) -> None:
    """Raise where a cell is too wide still; say how many cells close."""
    open_ones = [one for one in found if one.factor > 0]
    if not open_ones:
        return
    narrow = np.min([one.cell.half_width / one.factor for one in open_ones], axis=0)
    needed = np.prod(np.ceil(gains.half_width / np.maximum(narrow, 1e-12)))
    raise ValueError(
        f"cells: the gains from {gains.low.tolist()} to {gains.high.tolist()} are too wide for "
        f"{cells} cells; it takes about {needed:.0f}"
    )


def _bounded(loop: DisturbedLoop, cell: GainCell, reference: Reference, box: Box) -> _Bounded:
    """Bounds of one cell."""
    for gains in cell.corners:
        try:
            check_stable(gained(loop, gains))
        except UnstableLoop as error:
            raise UnstableLoop(f"gains {gains.tolist()}: {error}") from None
    middle = gained(loop, cell.middle)
    frames = frames_along(reference, middle.output)
    try:
        peaks = cell_peaks(loop, cell, middle, frames.basis, box.size)
    except TooWide as error:
        none = np.full(reference.steps, np.inf)
        controls = np.full(loop.control.shape, np.inf)
        return _Bounded(cell, none, controls, 0, np.inf, np.inf, error.factor)
    bound, _ = error_bounds(reference, middle.output, frames, peaks.tool)
    scored = np.asarray(reference.mask)[: reference.steps]
    at = int(np.argmax(np.where(scored, bound, -np.inf)))  # the first NaN, where there is one
    if np.isnan(bound[at]):
        raise ValueError(
            f"gains {cell.low.tolist()} to {cell.high.tolist()}: "
            f"the bound of the error is not a number at sample {at}"
        )
    between = float(np.linalg.norm(peaks.between[at]))
    control = (1 + ROUNDING) * peaks.control
    return _Bounded(cell, bound, control, at, float(bound[at]), between)
