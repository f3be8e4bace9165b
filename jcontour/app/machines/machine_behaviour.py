"""What a machine's model does: speeds that it reaches, how fast it settles, where it rings."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import matrix_balance, schur, solve_sylvester

from jcontour.app.files.results.run_metrics import AxisSummary
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import feed_words
from jcontour.linear.plant import LinearPlant

GRAVITY = 9.81  # [m/s^2]
QUESTIONED = 1000 * GRAVITY  # [m/s^2]: a unit is wrong, not a machine
FAST = 50.0  # [m/s] likewise
HARD = QUESTIONED / 10  # [m/s^2] of a limit or a motion, likewise
COARSE = 4.9e-5  # [m] of a count, likewise: 0.05 um read as mm
SLOW = 0.01  # [m/s^2] likewise
SHORTEST, LONGEST = 1e-5, 0.02  # [s], sample periods likewise
UNSEEN = 1e-3  # of a speed: what rounded numbers of a file may lack
STEPS, MOST_STEPS = 4000, 100_000  # samples of a step response, and of one that settles slowly
SETTLED = 5.0  # slowest time constants that it lasts
PEAK = 1.3  # a resonance rises this much
Kind = Literal["position", "speed", "acceleration", "nothing"]
AT_ONE = 1e-6  # modes nearer to 1 are integrators: two of them are computed 1e-8 off
THERE = 1e-6  # of the way: a term that adds less is rounding


class Steady(NamedTuple):
    """What lasts under one unit of control."""

    kind: Kind  # "nothing" where a mode grows without end
    gain: float  # its value [m, m/s, m/s^2 per control unit]; NaN of nothing
    slowest: float  # time constant of the slowest mode that dies out [samples]; 0 without one


def steady_response(model: LinearPlant, axis: int) -> Steady:
    """What lasts of an axis's own position under a constant control of its own.

    With the modes at 1 apart from all others, the transfer from the control to the position is

        H(z) = sum over j of c N^j b / (z - 1)^(j + 1) + R(z)
    N is what the modes at 1 have beside the 1, and R(1) is finite. The first term that is there
    decides: acceleration c N b / dt^2, speed c b / dt, or position R(1).
    """
    A, b, c = np.asarray(model.A), np.asarray(model.B)[:, axis], np.asarray(model.C)[axis]
    linked = A != 0
    own = _reached(linked, b != 0) & _reached(linked.T, c != 0)
    A, b, c = A[np.ix_(own, own)], b[own], c[own]
    poles = np.linalg.eigvals(A)
    near = np.abs(poles - 1) < AT_ONE
    sizes = np.abs(poles[~near])
    dying = sizes[(sizes > 1e-6) & (sizes < 1 - AT_ONE)]
    slowest = float(-1 / np.log(dying.max())) if dying.size else 0.0
    if np.any(np.abs(poles[~near]) > 1 + AT_ONE) or near.sum() > 2:
        return Steady("nothing", float("nan"), slowest)
    balanced, scale = matrix_balance(A)
    b, c = np.linalg.solve(scale, b), c @ scale
    decomposition: Any = schur(
        balanced.astype(complex), "complex", sort=lambda pole: abs(pole - 1) < AT_ONE
    )
    T, Q, m = decomposition
    b, c = Q.conj().T @ b, c @ Q
    X = solve_sylvester(T[:m, :m], -T[m:, m:], -T[:m, m:]) if 0 < m < len(A) else T[:m, m:]
    at_one, rest = b[:m] - X @ b[m:], c[:m] @ X + c[m:]
    N = T[:m, :m] - np.eye(m)
    position = float((rest @ np.linalg.solve(np.eye(len(A) - m) - T[m:, m:], b[m:])).real)
    speed, acceleration = float((c[:m] @ at_one).real), float((c[:m] @ N @ at_one).real)
    horizon = 10 * max(slowest, len(A))  # samples, by when the position is in steady motion
    ways = np.abs([position, horizon * speed, horizon**2 * acceleration])
    dt = model.dt
    if ways[2] > THERE * ways.max():
        return Steady("acceleration", acceleration / dt**2, slowest)
    if ways[1] > THERE * ways.max():
        return Steady("speed", speed / dt, slowest)
    return Steady("position", position, slowest)


def _reached(linked: np.ndarray, first: np.ndarray) -> np.ndarray:
    """States that others reach; `linked[i, j]` where state j acts on state i."""
    states = first
    for _ in first:
        states = states | linked @ states
    return states


def axis_behaviours(machine: Machine) -> list[AxisSummary]:
    """Behaviour of every axis of the nominal model."""
    return [_behaviour(machine.model, k, name) for k, name in enumerate(machine.axes)]


def questions(machine: Machine, behaviours: list[AxisSummary]) -> list[str]:
    """What cannot be true of a machine, most likely a wrong unit."""
    dt, lines = machine.model.dt, []
    if not SHORTEST <= dt <= LONGEST:
        lines.append(
            f"a sample period of {1e3 * dt:g} ms is unusual, most are of {1e3 * SHORTEST:g} to "
            f"{1e3 * LONGEST:g} ms; is its unit right?"
        )
    stated = machine.limits.acceleration
    for name, limit in zip(machine.axes, () if stated is None else stated, strict=False):
        if not SLOW <= limit <= HARD:
            lines.append(
                f"{name}: its limit on the acceleration is {limit:.3g} m/s^2; is length_unit right?"
            )
    if machine.resolution is not None:
        lines += coarse_counts(machine.axes, machine.resolution)
    largest = machine.limits.control
    if largest is None:
        return [*lines, "limits.control is not given: what the machine reaches is not known"]
    for k, one in enumerate(behaviours):
        most = float(np.broadcast_to(largest, len(behaviours))[k])
        acceleration = most * one.acceleration
        if one.kind != "position" and acceleration > QUESTIONED:
            lines.append(
                f"{one.name}: the largest control gives {acceleration / GRAVITY:.3g} g; "
                "is length_unit right?"
            )
        if one.kind == "speed" and most * one.gain > FAST:
            lines.append(
                f"{one.name}: the largest control gives {feed_words(most * one.gain)}; "
                "is length_unit right?"
            )
        speed = machine.limits.speed
        if one.kind == "speed" and speed is not None:
            allowed = float(np.broadcast_to(speed, len(behaviours))[k])
            if most * one.gain < (1.0 - UNSEEN) * allowed:
                lines.append(
                    f"{one.name}: the largest control gives {feed_words(most * one.gain)}, "
                    f"less than its limit of {feed_words(allowed)}"
                )
    return lines


def coarse_counts(axes: Sequence[str], resolution: float | np.ndarray) -> list[str]:
    """Counts [m] that no encoder of a machine has, one number or one for each axis."""
    each = np.broadcast_to(resolution, len(axes))
    return [
        f"{name}: counts of {1e6 * count:.4g} um are coarser than those of a machine; are lengths "
        "in um taken for mm?"
        for name, count in zip(axes, each, strict=True)
        if count > COARSE
    ]


def response(model: LinearPlant, axis: int, frequency: np.ndarray) -> np.ndarray:
    """Complex response from the axis's own control to its position, over frequency [Hz]."""
    A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
    z = np.exp(2j * np.pi * frequency * model.dt)
    state = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B[:, [axis]])
    return (C[axis] @ state)[:, 0]


def step_response(model: LinearPlant, axis: int, steady: Steady) -> np.ndarray:
    """Position after a step of one unit [m], sample by sample until the slowest mode is settled."""
    steps = int(np.clip(SETTLED * steady.slowest, STEPS, MOST_STEPS))
    A, b, c = np.asarray(model.A), np.asarray(model.B)[:, axis], np.asarray(model.C)[axis]
    x, step = np.zeros(len(A)), np.empty(steps + 1)
    for k in range(steps + 1):
        step[k] = c @ x
        x = A @ x + b
    return step


def _behaviour(model: LinearPlant, axis: int, name: str) -> AxisSummary:
    dt, steady = model.dt, steady_response(model, axis)
    step = step_response(model, axis, steady)
    speed = np.diff(step) / dt
    begin = np.abs(step[: STEPS + 1])
    moved = np.flatnonzero(begin > 1e-9 * begin.max())
    delay = int(moved[0]) - 1 if moved.size else STEPS
    changes = np.diff(speed, prepend=0.0) / dt
    seen = {"position": step, "speed": speed}.get(steady.kind, changes[1:])
    above = np.flatnonzero(np.abs(seen) >= (1 - np.exp(-1)) * abs(steady.gain))
    rise = dt * max(float(above[0]) - delay, 0.0) if above.size else float("nan")
    # Lightly damped modes that this control drives: the highest peak above a smooth curve
    poles = np.linalg.eigvals(np.asarray(model.A))
    turning = poles[(np.abs(poles.imag) > 1e-6) & (np.abs(poles) > 1e-6) & (poles.imag > 0)]
    resonance, most = float("nan"), PEAK
    for pole in turning:
        hertz = float(np.angle(pole)) / (2 * np.pi * dt)
        beside = np.array([0.8, 1.0, 1.25]) * hertz
        low, peak, high = np.abs(response(model, axis, beside))
        rises = peak / np.sqrt(low * high)
        if rises > most:
            resonance, most = hertz, float(rises)
    return AxisSummary(
        name=name,
        kind=steady.kind,
        gain=steady.gain,
        rise=rise,
        delay=delay,
        acceleration=float(np.abs(changes).max()),
        resonance=resonance,
    )
