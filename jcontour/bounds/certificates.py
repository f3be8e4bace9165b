"""Certificates: the largest error along a contour, proven, with the attack that comes close.

Tracking, on one axis:     |e(k)| <= |e without disturbance| + peak bound of y
Contour error otherwise:   the distance to the true path, see `distance`
Rounding of the sums is covered by a part in 10^10.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from jcontour.bounds.affine import NotAffine
from jcontour.bounds.distance import distance_bounds, frames_along
from jcontour.bounds.disturbed_loop import Box, DisturbedLoop, disturbed_loop
from jcontour.bounds.peak_bounds import Attack, peak_bounds, worst_attack
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.controllers.wrappers.adapters import BacklashCompensation
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import check_kinds

ROUNDING = 1e-10  # relative; adjoint and simulation agree to 1e-11


class Certificate(NamedTuple):
    """Largest errors and controls of a loop along its run.

    Attributes:
        bound: of the error that counts, at every sample [m].
        nominal: that error without disturbance [m].
        control: largest |u| of every control.
        rows: of the tool's position, across the path and then along it.
        spread: largest deviations in these directions [m].
        scored: which samples count.
        loop: matrices that the certificate is made of.
        box: of the disturbances.
    """

    bound: Float[np.ndarray, " T"]
    nominal: Float[np.ndarray, " T"]
    control: Float[np.ndarray, "T p"]
    rows: Float[np.ndarray, "T m N"]
    spread: Float[np.ndarray, "T m"]
    scored: Bool[np.ndarray, " T"]
    loop: DisturbedLoop
    box: Box

    @property
    def worst(self) -> int:
        """Scored sample of the largest bound."""
        return int(np.argmax(np.where(self.scored, self.bound, -np.inf)))

    @property
    def largest(self) -> float:
        """Largest bound of all scored samples [m]."""
        return float(self.bound[self.worst])

    def attacks(self, sample: int | None = None) -> list[Attack]:
        """Attacks on the error at a sample, one for each side and corner of where the tool may be.

        The sample of the largest bound is attacked when none is given. One of them comes close to
        the bound: across the path, or along it past a corner.
        """
        at = self.worst if sample is None else sample
        size = np.where(self.spread[at] > 0, self.spread[at], 1.0)
        scaled = self.rows[at] / size[:, None]
        sides = [side for side in product((1.0, 0.0, -1.0), repeat=len(size)) if any(side)]
        return [
            worst_attack(self.loop, np.array(side) @ scaled, at, self.box, 1.0) for side in sides
        ]


def certificate(
    plant: Plant, controller: Controller, reference: Reference, box: Box
) -> Certificate:
    """Largest errors that a linear loop can have along a reference, for all that the box allows.

    >>> from jcontour import contours, feed_laws, references
    >>> from jcontour.controllers import ContouringLQ, LQWeights
    >>> from jcontour.plants import bridgeport
    >>> machine, path = bridgeport(), contours.circle(1e-3)
    >>> controller = ContouringLQ(machine, LQWeights(3.0, 5.0, 2e-9), preview=5)
    >>> arc = feed_laws.constant_feed(path, 50e-3, machine.dt)
    >>> reference = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    >>> proof = certificate(machine, controller, reference, Box.of(0.02, 0.0, 2, 8))
    >>> bool(proof.nominal.max() < proof.largest < 1e-5)
    True

    Args:
        plant: without sensors that count: what they round is in the box.
        controller: linear in memory and measurement; limits that are not reached do not matter.
        reference: the run; its scored samples count.
        box: of force and error of the measurement.

    Raises:
        NotAffine: the loop is not linear, or a control may reach its limit.
        UnstableLoop: the loop is not stable.
        ValueError: as `simulate`; the box does not fit; or the undisturbed run leaves its contour.
        TypeError: the arguments are swapped, or of another kind.
    """
    check_kinds("certificate", plant=plant, controller=controller, reference=reference)
    loop = disturbed_loop(plant, controller, reference)
    p, q = loop.D.shape[1:]
    if box.force.shape != (p,) or box.noise.shape != (q,):
        raise ValueError(
            f"box: the loop has {p} controls and {q} measured numbers, "
            f"received {box.force.size} and {box.noise.size} bounds"
        )
    frames = frames_along(reference, loop.output)
    rows = frames.basis @ np.asarray(loop.C)
    spread, control = _peaks(loop, rows, box)
    check_limits(plant, controller, control, box)
    if spread.shape[1] == 1:
        nominal, bound = frames.lag, frames.lag + spread[:, 0]
    else:
        across = np.linalg.norm(spread[:, :-1], axis=1)
        nominal = frames.error
        bound = distance_bounds(reference, loop.output, frames, across, spread[:, -1])
    scored = np.asarray(reference.mask)[: reference.steps]
    return Certificate((1 + ROUNDING) * bound, nominal, control, rows, spread, scored, loop, box)


def _peaks(
    loop: DisturbedLoop, rows: Float[np.ndarray, "T m N"], box: Box
) -> tuple[Float[np.ndarray, "T m"], Float[np.ndarray, "T p"]]:
    """Largest deviations of the tool in some directions, and largest controls."""
    (T, m, _), (p, q) = rows.shape, loop.D.shape[1:]
    direct = np.zeros((T, m + p, p + q))
    direct[:, m:, p:] = loop.D
    both = np.concatenate([rows, loop.K], axis=1)
    peaks = peak_bounds(loop, both, box.size, direct).bound
    controls = np.abs(np.asarray(loop.control)) + peaks[:, m:]
    return peaks[:, :m], (1 + ROUNDING) * controls


def check_limits(plant: Plant, controller: Controller, control: np.ndarray, box: Box) -> None:
    """Raise NotAffine where a control may reach a limit, or what limits is not the control.

    The part of a controller under the control against friction is at most that larger.
    """
    own = control
    while isinstance(controller, FrictionFeedforward | BacklashCompensation):
        if isinstance(controller, FrictionFeedforward):
            _check_below(own, np.asarray(controller.limit))
            own = own + np.asarray(controller.coulomb)
        controller = controller.controller
    for name, limit in _limits(controller):
        if name != ".limit" or isinstance(controller, Cascade):
            raise NotAffine(
                f"{type(controller).__name__}: it has no exact bound, {name} limits more than the "
                "control; leave the limit out"
            )
        _check_below(own, limit)
    for _, limit in _limits(plant):
        _check_below(control + box.force, limit)


def _limits(module: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Finite limits of a plant or a controller, with their names."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(module):
        name = getattr(path[-1], "name", "") if path else ""
        if name.endswith("limit") and np.any(np.isfinite(leaf)):
            yield jax.tree_util.keystr(path), np.asarray(leaf)


def _check_below(control: np.ndarray, limit: np.ndarray) -> None:
    reached = np.any(control >= limit, axis=1)
    if reached.any():
        most, least = np.max(control), np.min(limit)
        raise NotAffine(
            f"limit: a control of up to {most:.4g} may reach its limit of {least:.4g}, first at "
            f"sample {int(np.argmax(reached))}; the loop is not linear there: give smaller bounds"
        )
