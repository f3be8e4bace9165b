"""Machines as they are and no model has them, stepped by a program of their own.

A motor and one or two masses behind springs, the first of them with a gap; friction that sticks and
falls with the speed, cogging, a current loop that lags and saturates, delays of parts of a sample.
A drive takes a force, or a position for a cascade of its own. The masses go on in steps of at most
`STEP`, semi-implicitly.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numba
import numpy as np
from jaxtyping import Complex, Float

STEP = 25e-6  # [s] at most
INNER = 250e-6  # [s] sample period of the cascade in a drive that takes a position
LONGEST = 8.0  # [s] of an answer to a pulse


@dataclass(frozen=True)
class TrueAxis:
    """One axis."""

    # what its drive takes: a force, as a current [A], or a position [m]
    takes: Literal["force", "position"]
    # motor first [kg]; the last one of three is 0 where there are two
    masses: tuple[float, float, float]
    # stiffness, damping: of the two springs [N/m], [N s/m]
    stiffness: tuple[float, float]
    damping: tuple[float, float]
    gap: float  # of the first one [m]
    # coulomb, static, viscous: friction of the masses [N], [N], [N s/m]
    coulomb: tuple[float, float, float]
    static: tuple[float, float, float]
    viscous: tuple[float, float, float]
    stribeck: float  # speed at which friction has fallen [m/s]
    # cogging, pitch: of the motor [N], [m]
    cogging: float
    pitch: float
    force: float  # of a unit of current [N/A]
    current: float  # time constant of the current loop [s]
    largest: float  # current at most [A]
    delay: float  # of the command [s]
    # gains of the drive's own cascade: position [1/s], speed [A s/m]
    inner: tuple[float, float] = (0.0, 0.0)
    load_side: bool = False  # whether the encoder is at the last mass
    count: float = 1e-6  # of the encoder [m]

    @property
    def numbers(self) -> Float[np.ndarray, " n"]:
        """All that `_advanced` reads."""
        parts = (self.masses, self.coulomb, self.static, self.viscous, self.stiffness, self.damping)
        rest = (self.gap, self.stribeck, self.cogging, self.pitch, self.force, self.current)
        more = (self.largest, *self.inner, float(self.takes == "position"))
        return np.array([*(value for part in parts for value in part), *rest, *more])

    @property
    def linear(self) -> "TrueAxis":
        """The axis without friction that sticks, gap, cogging and limit."""
        none = (0.0, 0.0, 0.0)
        return replace(self, coulomb=none, static=none, gap=0.0, cogging=0.0, largest=1e12)

    @property
    def last(self) -> int:
        """Place of the tool among the masses."""
        return 2 if self.masses[2] else 1


@dataclass
class Moving:
    """An axis that moves."""

    axis: TrueAxis  # which one
    dt: float  # sample period of its command [s]
    # places, speeds, current, command of the inner loop, time to its next sample
    state: Float[np.ndarray, " 9"] = field(init=False)
    line: Float[np.ndarray, " L"] = field(init=False)  # commands on their way
    head: int = 0  # place of the next one

    def __post_init__(self):
        """It begins at rest at zero."""
        self.steps = int(np.ceil(self.dt / STEP))
        self.state = np.zeros(9)
        self.line = np.zeros(max(round(self.axis.delay * self.steps / self.dt), 0) + 1)
        self.numbers = self.axis.numbers

    @property
    def tool(self) -> float:
        """Position of the last mass [m]."""
        return float(self.state[self.axis.last])

    @property
    def exact(self) -> float:
        """Position at the encoder, as it is [m]."""
        return self.tool if self.axis.load_side else float(self.state[0])

    def read(self, noise: float = 0.0) -> float:
        """Position that the encoder counts [m]."""
        count = self.axis.count
        return count * round((self.exact + noise) / count) if count else self.exact

    def step(self, command: float) -> None:
        """Go on by a sample under a held command."""
        h = self.dt / self.steps
        self.head = _advanced(
            self.state, self.line, self.head, self.numbers, command, self.steps, h, self.axis.count
        )


@numba.njit(cache=True)
def _advanced(state, line, head, p, command, steps, h, count):
    x, v, late = state[:3], state[3:6], len(line)
    for _ in range(steps):
        line[head] = command
        head = (head + 1) % late
        arrives = line[head]
        if p[25] > 0.5:  # a cascade of its own
            state[8] -= h
            if state[8] <= 1e-9:
                place = count * np.round(x[0] / count) if count > 0 else x[0]
                state[7] = p[24] * (p[23] * (arrives - place) - v[0])
                state[8] += 250e-6
            arrives = state[7]
        arrives = min(max(arrives, -p[22]), p[22])
        state[6] += min(h / p[21], 1.0) * (arrives - state[6])
        force = p[20] * state[6] + p[18] * np.sin(2 * np.pi * x[0] / p[19])
        apart = x[0] - x[1]
        bent = np.sign(apart) * max(abs(apart) - p[16] / 2, 0.0)
        first = p[12] * bent + (p[14] * (v[0] - v[1]) if bent != 0 or p[16] == 0 else 0.0)
        second = p[13] * (x[1] - x[2]) + p[15] * (v[1] - v[2]) if p[2] > 0 else 0.0
        for k in range(3):
            if p[k] == 0:
                x[k], v[k] = x[1], v[1]
                continue
            pull = (force - first, first - second, second)[k]
            if v[k] == 0 and abs(pull) <= p[6 + k]:
                continue
            way = np.sign(v[k]) if v[k] != 0 else np.sign(pull)
            dry = p[3 + k] + (p[6 + k] - p[3 + k]) * np.exp(-((v[k] / p[17]) ** 2))
            after = v[k] + h * (pull - dry * way - p[9 + k] * v[k]) / p[k]
            v[k] = 0.0 if v[k] * after < 0 and abs(pull) <= p[6 + k] else after
            x[k] += h * v[k]
    return head


Law = Callable[[Float[np.ndarray, " m"]], Float[np.ndarray, " m"]]


@dataclass(frozen=True)
class TrueRun:
    """What happened: command, encoder and tool by sample and axis."""

    command: Float[np.ndarray, "T m"]
    position: Float[np.ndarray, "T m"]
    tool: Float[np.ndarray, "T m"]


def stepped(axes: list[TrueAxis], dt: float, law: Law, rows: int, start=(0.0, 0.0)) -> TrueRun:
    """Axes under a law that is asked once a sample with the counted positions."""
    moving = [Moving(one, dt) for one in axes]
    for one, place in zip(moving, start, strict=False):
        one.state[:3] = place
        one.line[:] = place if one.axis.takes == "position" else 0.0
    commands, places, tools = [], [], []
    for _ in range(rows):
        measured = np.array([one.read() for one in moving])
        command = law(measured)
        places.append([one.exact for one in moving])
        tools.append([one.tool for one in moving])
        commands.append(command)
        for one, value in zip(moving, command, strict=True):
            one.step(float(value))
    return TrueRun(*(np.array(part) for part in (commands, places, tools)))


def response(axis: TrueAxis, dt: float, w: Float[np.ndarray, " F"]) -> Complex[np.ndarray, " F"]:
    """From a held command to the position at frequencies w [rad per sample], by a pulse's answer.

    What is not linear is left out.
    """
    one = Moving(replace(axis.linear, count=0.0), dt)
    places = []
    for k in range(int(LONGEST / dt)):
        places.append(one.exact)
        one.step(1e-6 if k == 0 else 0.0)
    speed = np.diff(np.array([*places, one.exact], float)) * 1e6
    speed = speed - speed[-1]  # what is left of a long answer decays no more
    back = np.exp(-1j * np.outer(w, np.arange(len(speed)) + 1))
    total: Complex[np.ndarray, " F"] = back @ speed
    return total / (1 - np.exp(-1j * w))
