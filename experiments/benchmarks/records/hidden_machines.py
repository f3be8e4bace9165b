"""Random axes whose records are all that an identification sees, and which then tell the truth."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from jcontour.app.jobs.excitation import Excited
from jcontour.linear.continuous_axes import (
    ContinuousAxis,
    force_axis,
    position_axis,
    sampled_axis,
    speed_axis,
    with_resonance,
)
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.found import MachineRecord
from tuning.identification.linear.recording import FEEDBACK, RecordedAxis, Takes, recorded

KINDS: tuple[Takes, ...] = ("speed", "position", "force")
COUNTS = (0.1e-6, 1e-6)  # encoder [m]
DT, SECONDS = 1e-3, 60.0
LIMITS = Excited(("X", "Y"), DT, np.full(2, 0.4), np.full(2, 0.25), np.full(2, 2.0))
PROGRAMS = ("contour", "excite")
LOOP_GAIN = 0.5  # of a loop that is stable whatever its delay: its sensitivity stays below 2


def hidden_axis(random: np.random.Generator, dt: float, takes: Takes | None = None) -> RecordedAxis:
    """A random axis with a cascade that is stable with room; of any kind, or of the one given."""
    drawn = KINDS[int(random.integers(len(KINDS)))]
    kind = takes or drawn
    delay = dt * float(random.integers(4))
    constant = float(np.exp(random.uniform(np.log(4e-3), np.log(40e-3))))
    gain = float(np.exp(random.uniform(np.log(0.5), np.log(2.0))))
    if kind == "speed":
        axis = speed_axis(gain, constant, delay)
        bandwidth = 0.25 / (constant + delay + 2 * dt)
        loop = (bandwidth / gain,)
    elif kind == "position":
        axis = position_axis(gain, constant, delay)
        loop = (1.0 / gain,)
    else:
        mass, viscous = float(random.uniform(20, 150)), float(random.uniform(50, 400))
        force = 35 * gain
        axis = force_axis(force, mass, viscous, delay)
        inner = 0.2 / (delay + 2 * dt)
        loop = (inner / 5, inner * mass / force)
    if kind != "force" and random.uniform() < 0.3:
        axis = _resonant(axis, kind, random)
    count = float(np.exp(random.uniform(*np.log(COUNTS))))
    return RecordedAxis(axis, kind, count, 0.5 * count, float(random.uniform(0, 0.003)), loop)


def late_by_a_part(one: RecordedAxis, dt: float, random: np.random.Generator) -> RecordedAxis:
    """The axis with a delay of a part of a sample more, as drives have it."""
    part = dt * float(random.uniform(0.1, 0.9))
    return replace(one, axis=replace(one.axis, delay=one.axis.delay + part))


def _resonant(axis: ContinuousAxis, takes: Takes, random: np.random.Generator) -> ContinuousAxis:
    """The axis behind a random resonance; another one where the cascade of a drive would ring."""
    while True:
        frequency, damping = 2 * np.pi * random.uniform(40, 90), random.uniform(0.05, 0.2)
        found = with_resonance(axis, frequency, damping)
        if takes != "position" or FEEDBACK * _largest_gain(found) < LOOP_GAIN:
            return found


def _largest_gain(axis: ContinuousAxis) -> float:
    """Largest gain of an axis whose drive takes a position [m per unit of command]."""
    return float(np.abs(axis.response(2 * np.pi * np.geomspace(1.0, 200.0, 400))).max())


def hidden_record(axes: list[RecordedAxis], program: str, seed: int) -> MachineRecord:
    """Record of the axes while they run one of `PROGRAMS` under their cascades."""
    rows = int(SECONDS / DT)
    signals = []
    for k, one in enumerate(axes):
        random = np.random.default_rng([seed, k])
        signals.append(recorded(one, _reference(program, rows, k), DT, random))
    u, y = (np.stack(part, axis=1) for part in zip(*signals, strict=True))
    return MachineRecord(DT, ("X", "Y"), u, y)


def _reference(program: str, rows: int, axis: int) -> Float[np.ndarray, " T"]:
    """Arcs of three sizes and lines between corners; or the sines of `--excite`, repeated."""
    time = DT * np.arange(rows)
    if program == "excite":
        return np.resize(program(LIMITS)[:-1, axis], rows)
    arcs = sum(
        size * np.sin(2 * np.pi * hertz * time + axis)
        for size, hertz in ((0.02, 0.3), (0.004, 1.7), (0.001, 6.0))
    )
    return arcs + 0.05 * DT * np.cumsum(np.sign(np.sin(2 * np.pi * (0.21 + 0.1 * axis) * time)))


def true_model(axis: RecordedAxis) -> AxisModel:
    """The axis as an identification would have it, from its Markov parameters."""
    A, B, C, late = sampled_axis(axis.axis, DT)
    below = np.poly(np.linalg.eigvals(A)).real
    markov, x = [], B[:, 0]
    for _ in range(len(A)):
        markov.append((C @ x).item())
        x = A @ x
    above = np.convolve(below, markov)[: len(A)]
    integrators = 0 if axis.takes == "position" else 1
    if integrators:
        below, _ = np.polydiv(below, [1.0, -1.0])
    return AxisModel(below[1:], above, integrators, late, DT)
