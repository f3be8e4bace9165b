"""Predictive control that never leaves a tolerance, for a machine seen by encoders.

The tolerance of a part has four shares: what disturbances make of the tool, what the filter does
not know of it, the error of the undisturbed run, and the bend of the path.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from jcontour.app.jobs.job import Task
from jcontour.app.machines.disturbance_bounds import Bounds
from jcontour.app.machines.linear import LinearMachine
from jcontour.controllers.observers.kalman import kalman_gain
from jcontour.host.controller import HostController
from jcontour.host.observed import FilterGain
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.references import Reference
from jcontour.mpc.bounded.bounded_mpc import BoundedMPC, Need
from jcontour.mpc.bounded.filtered_response import FilteredResponse, Surroundings, filtered_response
from jcontour.qp.solvers import Solver
from jcontour.sets.least_peaks import NoResponse

LENGTHS = (8, 12, 20, 30)  # samples; longer ones promise hardly more and take longer to solve
ENOUGH = 1.02  # times the best promise: the shortest that is as good
NOISES = np.geomspace(0.01, 10.0, 7)  # of the machine's own control noise: filters to choose from
ROUNDS = 3  # of leaving the controls what the path needs of them
LEFT = 0.99  # of what the path leaves


class Shares(NamedTuple):
    """Shares of a tolerance at the sample that needs most [m]."""

    disturbances: float
    unknown: float
    nominal: float
    bend: float

    @property
    def least(self) -> float:
        """The least tolerance of the part."""
        return sum(self)


@dataclass(frozen=True)
class Keeper:
    """A bounded MPC on one part.

    Attributes:
        machine: it is for.
        late: samples of the machine's unknown delay that its model has.
        model: with that delay.
        around: what acts on it.
        response: filter and responses.
        mpc: fed the filter's estimate.
        reference: the run along the part.
    """

    machine: LinearMachine
    late: int
    model: LinearPlant
    around: Surroundings
    response: FilteredResponse
    mpc: BoundedMPC
    reference: Reference

    @property
    def controller(self) -> HostController:
        """The MPC behind its filter."""
        return FilterGain(self.response.gain).around(self.mpc, self.model)

    @property
    def shares(self) -> Shares:
        """What the tolerance is made of."""
        frames = self.mpc.certified(self.reference)
        used = self.reference.steps + self.mpc.response.length
        worst = int(np.argmax(frames.certified[:used]))
        return Shares(
            float(frames.peak[worst, -1]),
            self.response.missed,
            float(np.abs(frames.nominal[worst, -1])),
            float(frames.off[worst]),
        )

    @property
    def promised(self) -> float:
        """Largest distance of the tool from the path [m]."""
        frames = self.mpc.certified(self.reference)
        return self.mpc.promised(frames, self.reference.steps) + self.response.missed


def keeper(
    machine: LinearMachine,
    late: int,
    task: Task,
    bounds: Bounds,
    length: int | None,
    offset_free: bool,
    tolerance: float | None,
    solver: Solver,
) -> Keeper:
    """The bounded MPC of a part, with the shortest responses that promise as much as longer ones.

    Raises:
        ValueError: the machine states no limit on its controls, the limits leave no room, or the
            tolerance [m] cannot be promised.
    """
    if machine.limits.control is None:
        raise ValueError(
            f"tolerance: {machine.name} states no limit on its controls: what its drives can do "
            "decides what can be promised"
        )
    around = Surroundings(bounds.force, bounds.encoder)
    lengths = LENGTHS if length is None else (length,)
    found = _with_room(machine, late, task, around, lengths, offset_free, solver)
    if tolerance is None:
        return found
    shares = found.shares
    if tolerance < shares.least:
        told = ", ".join(f"{1e6 * size:.4g} um {name}" for name, size in _named(shares))
        raise ValueError(
            f"tolerance-um: {1e6 * tolerance:.6g} um cannot be promised on {task.name}, the least "
            f"is {1e6 * shares.least:.4g} um: {told}"
        )
    known = tolerance - shares.unknown
    mpc = BoundedMPC(found.model, found.mpc.least, found.mpc.limits, known, solver=solver)
    return replace(found, mpc=mpc)


def _named(shares: Shares) -> list[tuple[str, float]]:
    names = ("by disturbances", "unknown to the encoders", "of the undisturbed run", "by its bend")
    return list(zip(names, shares, strict=True))


def _with_room(
    machine: LinearMachine,
    late: int,
    task: Task,
    around: Surroundings,
    lengths: tuple[int, ...],
    offset_free: bool,
    solver: Solver,
) -> Keeper:
    """Responses that leave controls and speeds what the path needs of them.

    Raises:
        ValueError: they cannot; it names the limit.
    """
    model, limits = with_input_delay(machine.model, late), machine.limits
    control = np.asarray(limits.control, float)
    speed = np.full(model.axes, np.inf) if limits.speed is None else np.asarray(limits.speed)

    def keeping(room: tuple[np.ndarray, np.ndarray]) -> Keeper:
        # The shortest responses whose promise is nearly the best
        gains = [
            np.asarray(kalman_gain(model, noise, machine.measurement_noise))
            for noise in machine.control_noise * NOISES
        ]
        found, refused = [], ValueError("length: needs at least one")
        for length in lengths:
            try:
                found.append(filtered_response(model, gains, around, room, length, offset_free))
            except ValueError as none:
                refused = none
        if not found:
            force = float(np.max(around.force))
            raise ValueError(no_answer(machine, force, refused)) from None
        best = min(one.tolerance for one in found)
        response = next(one for one in found if one.tolerance <= ENOUGH * best)
        kept = response.limits(model, control, speed)
        mpc = BoundedMPC(model, response.least, kept, solver=solver)
        reference = task.reference(model.dt, mpc.preview)
        return Keeper(machine, late, model, around, response, mpc, reference)

    found = keeping((control, speed))
    for _ in range(ROUNDS):
        needs = found.mpc.needs(found.reference)
        fits = all(need.value + need.peak <= need.signal.limit for need in needs)
        if fits or any(need.value >= need.signal.limit for need in needs):
            break
        found = keeping((_left(control, needs, "control"), _left(speed, needs, "speed")))
    found.mpc.prepare(found.reference)  # names the limit that the path does not keep
    return found


def _left(limits: np.ndarray, needs: list[Need], kind: str) -> np.ndarray:
    """What the path leaves of the limits of a kind."""
    taken = [need.value for need in needs if need.signal.name.startswith(kind)]
    return LEFT * (limits - taken) if taken else limits


def no_answer(machine: LinearMachine, force: float, refused: ValueError) -> str:
    """One line: the force, where it comes from, and which limit is too small for an answer.

    Args:
        machine: with a limit on its controls.
        force: bound on what adds to each control [control unit].
        refused: why there is no response; its signals are speeds by axis, controls by input.
    """
    share = force / float(np.min(np.asarray(machine.limits.control)))
    usual = np.isclose(force, max(machine.control_noise, machine.largest_friction))
    why, units = str(refused), {"speed": "m/s", "control": machine.control_unit}
    if isinstance(refused, NoResponse) and refused.needed:
        why = "; ".join(
            f"{name} needs {needed:.3g} {units[name.partition(' ')[0]]}, the path leaves "
            f"{refused.asked[name]:.3g}"
            for name, needed in refused.needed.items()
        )
    return (
        f"force: {force:g} {machine.control_unit} on every control ({100 * share:.3g} % of the "
        f"smallest control limit{' by default' if usual else ''}; --force sets it) leaves nothing "
        f"to answer it with: {why}"
    )
