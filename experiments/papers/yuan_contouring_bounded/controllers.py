"""The thesis's two contouring controllers along a tube: rows that they keep, and what is promised.

CEBC-1 (section 5.3) keeps the tracking error of each axis, one controller for the head and one for
the beam. By Lemma 5.1 and Remark 5.1 the contour error is below
    (|x* - x_h| + d |theta|) + |y* - y_e|.
CEBC-2 (section 5.4) keeps the distance from the path: |nu| across and |tau| along it, in the frame
of the reference point. On lines and arcs of radius R the contour error is below |nu| + tau^2 / 2R.
No polygon, and no set that waits for its turn, is needed.
"""

from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from experiments.papers.yuan_contouring_bounded.tubes import DISTURBANCE, SPARE, Part, Tube
from experiments.papers.yuan_gantry.experiment import RADIUS
from jcontour import Reference
from jcontour.host.controller import HostController, Stepped, StepReport
from jcontour.mpc import BoundedMPC, KeptRows
from jcontour.plants import thesis_gantry
from jcontour.sets.responses import VaryingResponse

CURRENT = 10.0  # [A] limit of every motor: ours, as in the library's gantry
SLOW = 125  # samples of half a period of a slow disturbance


class Promise(NamedTuple):
    """Bounds that a controller keeps."""

    contour: float  # largest contour error [m]
    # largest tracking error of the tool along X and Y [m]; None where none is kept
    axes: tuple[float, float] | None
    twist: float  # largest |theta| [rad]


class Parted(HostController):
    """Controllers of disjoint parts of the machine."""

    def __init__(self, parts: tuple[Part, ...], controllers: tuple[BoundedMPC, ...]):
        self.parts, self.controllers = parts, controllers
        self.seconds: list[float] = []  # processor time of every step that had an answer
        self.preview = max(one.preview for one in controllers)

    def prepare(self, reference: Reference) -> Any:
        """Plans of all."""
        return tuple(one.prepare(reference) for one in self.controllers)

    def initial_memory(self, reference: Reference) -> Any:
        """Memories of all."""
        return tuple(one.initial_memory(reference) for one in self.controllers)

    def step(self, memory: Any, plan: Any, measurement: Any) -> Stepped:
        """Step of each on its own states; a QP without an answer raises `Unsolved`."""
        began = thread_time()
        control, memories, reports = np.zeros(3), [], []
        each = zip(self.parts, self.controllers, memory, plan, strict=True)
        for part, one, inner, row in each:
            seen = measurement[[i for i in part.states if i < len(measurement)]]
            following, currents, report = one.step(inner, row, seen)
            control[list(part.inputs)] = currents
            memories.append(following)
            reports.append(report)
        active, residual, iterations, *_ = zip(*reports, strict=True)
        self.seconds.append(thread_time() - began)
        return tuple(memories), control, StepReport(sum(active), max(residual), sum(iterations))


def controller(tube: Tube) -> tuple[Parted, Promise]:
    """Controllers of all parts, and what they promise together."""
    made = [
        _part_controller(tube, part, response)
        for part, response in zip(tube.design.parts, tube.responses, strict=True)
    ]
    whole, x, theta = Parted(tube.design.parts, tuple(made)), tube.state[0], tube.state[2]
    # second order of the tool in the deviation [m]
    reach = float(np.abs(tube.machine.run.state[:, 0]).max() + thesis_gantry().tool_offset)
    bend = float(x * theta + reach * theta**2 / 2)  # |dx theta| + (|x_h| + d) theta^2 / 2
    if not tube.design.apart:
        across, along = made[0].kept.limit[0, :2] + bend
        return whole, Promise(float(across + along**2 / (2 * RADIUS)), None, float(tube.state[2]))
    kept = [float(one.kept.limit[0, 0]) for one in made]
    tools, every = tube.machine.tool.swapaxes(0, 1), np.arange(len(tube.state))
    # what the states of the other part do to the tool along this axis
    axes = [
        size
        + bend
        + float((np.abs(tool) @ np.where(np.isin(every, part.states), 0.0, tube.state)).max())
        for size, part, tool in zip(kept, tube.design.parts, tools, strict=True)
    ]
    return whole, Promise(sum(axes), (axes[0], axes[1]), float(tube.state[2]))


def _part_controller(tube: Tube, part: Part, response: VaryingResponse) -> BoundedMPC:
    """Controller of a part: its rows of the tool first, then the tube of its states."""
    R, states, inputs = response.samples, list(part.states), list(part.inputs)
    machine = tube.machine
    # unit rows (R, r, 2) of the tool that are kept
    tangent, names = np.asarray(machine.reference.tangent)[:R], ("across", "along")
    directions = np.stack([np.stack([-tangent[:, 1], tangent[:, 0]], axis=1), tangent], axis=1)
    if len(inputs) < 3:
        axis = int(part.inputs != (0,))
        directions, names = np.broadcast_to(np.eye(2)[axis], (R, 1, 2)), ("xy"[axis],)
    off = machine.run.output[:R] - np.asarray(machine.reference.position)[:R]
    rows = directions @ machine.tool[:R, :, states]
    value = np.einsum("krm,km->kr", directions, off)
    peaks = response.growth(rows, np.zeros((*rows.shape[:2], len(inputs))))[..., -1]
    most = SPARE * (np.abs(value) + peaks).max(axis=0)
    each = np.broadcast_to(np.eye(len(states)), (R, len(states), len(states)))
    kept = KeptRows(
        (*names, *(f"state {i}" for i in states)),
        np.concatenate([rows, each], axis=1),
        np.concatenate([value, np.zeros((R, len(states)))], axis=1),
        np.broadcast_to(np.concatenate([most, tube.state[states]]), (R, len(most) + len(states))),
    )
    nominal = machine.control[:R, inputs]
    # currents that wait are states: their limit is the same
    limit = np.minimum(CURRENT - np.abs(nominal), tube.current[inputs])
    late = tube.design.late
    return BoundedMPC(machine.state[:R, states], nominal, response, kept, limit, late)


def attack(tube: Tube, whole: Parted, steps: int) -> Float[np.ndarray, "T p"]:
    """Disturbances of the motors [A] that drive the tool to its peak, to and fro.

    Every N samples they aim at the side of the path that is opposite to the last one's.
    """
    forces, design = np.zeros((steps, 3)), tube.design
    tangent = np.asarray(tube.machine.reference.tangent)
    parts = zip(design.parts, tube.responses, whole.controllers, strict=True)
    for axis, (part, response, one) in enumerate(parts):
        N, inputs = response.length, list(part.inputs)
        for turn, end in enumerate(range(N, steps + 1, N)):
            side = -1.0 if turn % 2 else 1.0
            if design.apart:  # both axes towards one side of the path
                side *= np.sign((-tangent[end, 1], tangent[end, 0])[axis]) or 1.0
            worst = response.attack(one.kept.state[end, 0], end)[:, : len(inputs)]
            forces[end - N : end, inputs] = side * worst
    return DISTURBANCE * forces


def random_forces(steps: int) -> Float[np.ndarray, "T p"]:
    """Disturbances of the motors [A]: from one end to the other, slowly, then at random."""
    half = steps // 2
    slow = np.where(np.arange(half) // SLOW % 2 == 0, 1.0, -1.0)[:, None] * np.ones(3)
    fast = np.sign(np.random.default_rng(0).normal(size=(steps - half, 3)))
    return DISTURBANCE * np.concatenate([slow, fast])
