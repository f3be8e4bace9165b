"""Two companions in the same volume of which there is no text: their textbook forms, run.

Gain scheduling (Shahruz & Behtash): a loop that is stable wherever it is frozen grows when it moves
faster than a rate, and dies out below it. With x' = A(p) x and A' P + P A = -I for every frozen p,

    d/dt x' P x = -|x|^2 + p' x' (dP/dp) x,
so the loop is stable while |p'| |dP/dp| < 1 (Shamma & Athans 1990).

Learning in Cartesian space (Guglielmo & Sadegh): the force at the tool of an arm is learned from
cycle to cycle, with no model of its masses.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from jcontour import learn
from jcontour.controllers import CartesianControl, PType
from jcontour.controllers.learning.cartesian import cartesian_cycles
from jcontour.motion import from_samples
from jcontour.plants import TwoLinkArm

GRID = np.linspace(0, 2 * np.pi, 37)  # parameters at which the loop is frozen
FAST, TIME = 1.0, 20.0  # [rad/s] at which the loop grows as exp(t/2), and how long it is run [s]
STIFFNESS, DAMPING = 6000.0, 300.0  # [N/m], [N s/m] at the tool
LAW = PType(0.9, lead=1, smoothing=2)
SAMPLES, CYCLES = 800, 6  # of a cycle of 1.6 s


@dataclass(frozen=True)
class Schedule:
    """A scheduled loop, frozen and moving."""

    frozen: float  # largest real part of its eigenvalues at any frozen parameter [1/s]
    rate: float  # estimate of the admissible rate [rad/s]
    time_s: Float[np.ndarray, " T"]
    slow: Float[np.ndarray, " T"]  # size of the state at that rate, one at first
    fast: Float[np.ndarray, " T"]  # and at one radian per second


@dataclass(frozen=True)
class Cycles:
    """RMS error of the tool in every cycle [m]."""

    light: Float[np.ndarray, " C"]
    heavy: Float[np.ndarray, " C"]  # masses half as large again, the same law


def turning(angle: Any, using: Any = jnp) -> Any:
    """Matrix with the eigenvalues -1/4 +- j sqrt(7)/4 at every angle (Markus & Yamabe 1960).

        A = [[-1 + 1.5 c^2, 1 - 1.5 c s], [-1 - 1.5 c s, -1 + 1.5 s^2]],  c = cos, s = sin
    Turned at one radian per second from x = (1, 0), the state is exp(t/2) (cos t, -sin t).
    """
    c, s = using.cos(angle), using.sin(angle)
    rows = [[-1 + 1.5 * c * c, 1 - 1.5 * c * s], [-1 - 1.5 * c * s, -1 + 1.5 * s * s]]
    return using.array(rows)


def admissible_rate(matrix: Callable[[Any], Any], parameters: Iterable[float]) -> float:
    """Estimate of the largest rate |p'| at which the loop is stable [parameter per second].

        1 / max over p of |dP/dp|,   A' dP + dP A = -(dA' P + P dA)
    The maximum is that over the parameters given: one over the whole interval would be a bound.
    """
    sizes = []
    for p in parameters:
        A, dA = (np.asarray(each) for each in jax.jvp(matrix, (float(p),), (1.0,)))
        P = solve_continuous_lyapunov(A.T, -np.eye(len(A)))
        dP = solve_continuous_lyapunov(A.T, -(dA.T @ P + P @ dA))
        sizes.append(float(np.linalg.norm(dP, 2)))
    return 1 / max(sizes)


def scheduled() -> Schedule:
    """The turning matrix, frozen and moved."""
    frozen = max(float(np.linalg.eigvals(turning(p, np)).real.max()) for p in GRID)
    rate, time = admissible_rate(turning, GRID), np.linspace(0, TIME, 201)

    def moved(speed: float) -> Float[np.ndarray, " T"]:
        def slope(t, x):
            return turning(speed * t, np) @ x

        run = solve_ivp(slope, (0, TIME), [1.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-12)
        return np.linalg.norm(run.y, axis=0)

    return Schedule(frozen, rate, time, moved(rate), moved(FAST))


def learned() -> Cycles:
    """A circle of 60 mm radius, on the arm and on a heavier one."""
    arm, share = TwoLinkArm(), np.arange(SAMPLES + 1) / SAMPLES
    angle = 2 * np.pi * share - np.sin(2 * np.pi * share)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place = np.array([0.35, 0.3]) + 0.06 * around
    tangent = np.stack([-around[:, 1], around[:, 0]], axis=1)
    path = from_samples(place, tangent, arm.dt, preview=1, in_motion=False)
    nothing = jnp.zeros((SAMPLES, 2))
    control = CartesianControl(arm, STIFFNESS, DAMPING, nothing, arm.dt)
    heavier = TwoLinkArm(mass=(12.0, 6.0), inertia=(0.18, 0.06), viscous=(1.0, 0.6))

    def errors(plant: TwoLinkArm) -> Float[np.ndarray, " C"]:
        laps, _ = learn(cartesian_cycles(lambda _: plant, control, path), LAW, CYCLES, nothing)
        off = np.asarray(laps.output) - place[:SAMPLES]
        return np.sqrt(np.mean(np.sum(off**2, axis=2), axis=1))

    return Cycles(errors(arm), errors(heavier))
