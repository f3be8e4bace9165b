"""Runs behind McNab & Tsao: their circle, a line at 37 degrees, a family of machines, frozen loops.

Compiling costs more than simulating here. Controllers of every weight and horizon therefore share
one compiled plan and one compiled closed loop: the horizon is an array, and the nominal machine is
a member of the family.
"""

from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour.controller import Controller
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
    Terminal,
    contour_weight,
    control_weight,
)
from jcontour.controllers.lq.preview_lq import PreviewLQ
from jcontour.geometry.contours import circle, line
from jcontour.linear.plant import (
    AffinePlan,
    LinearPlant,
    SteadyMotion,
    spectral_radius,
    steady_motion,
)
from jcontour.linear.transformations import with_input_delay, with_input_gains
from jcontour.motion.references import Reference, along
from jcontour.plant import Plant
from jcontour.plants.bridgeport import bridgeport
from jcontour.plants.wrappers.delays import Delayed
from jcontour.riccati.receding_horizon import CostToGo, first_control, one_stage_back
from jcontour.simulation.closed_loop import follow, prepared
from jcontour.simulation.evaluation import member, stack_plants, stack_references
from jcontour.simulation.metrics import Metrics, score_signals

TERMINALS = ("output", "dare")  # C'QC, and H_s(Q_max)
PREVIEW = 10  # [samples] the paper's horizon, where it does not vary it
RADIUS = 1e-3  # [m] of the paper's circle
FEED = 3 / 60  # [m/s] the paper's 3 m/min
RHO = 2e-9  # [1/control unit^2] the paper's control weight
STEPS = 753  # three laps of 251.3 samples
WINDOW = (502, 753)  # the last lap is scored: the transient is gone
LINE_ANGLE = np.deg2rad(37.0)  # no symmetry of the machine in this direction
LONGEST = 30  # [samples] of the preview lengths in Figs 9 and 10
RADIUS_STRIDE = 5  # frozen loops every 7 degrees of the circle: the radius varies slowly


@dataclass(frozen=True)
class Case:
    """A controller of the study; rho is the paper's."""

    terminal: str
    alpha: float
    beta: float
    preview: int = PREVIEW


@dataclass(frozen=True)
class Member:
    """A machine: factors on its two inputs, and an input delay [samples].

    The controller knows neither.
    """

    gain_x: float
    gain_y: float
    delay: int


class FamilyRun(NamedTuple):
    """One controller on the whole family, axis (member): metrics, frozen radius, output."""

    metrics: Metrics
    spectral_radius: Float[np.ndarray, " members"]
    output: Float[np.ndarray, "members T m"]


class AnyHorizonLQ(Controller):
    """`ContouringLQ` whose horizon is an array: all horizons share one compilation.

    The horizon is between 1 and `preview`. The backward sweep starts at the longest horizon and
    leaves the terminal cost as it is until j < horizon. The gains are those of `ContouringLQ`, the
    time is that of the longest horizon.
    """

    model: LinearPlant
    weights: LQWeights
    horizon: Int[Array, ""]
    terminal: Terminal
    preview: int = eqx.field(static=True)

    def __init__(self, model: LinearPlant, weights: LQWeights, horizon: int, terminal: Terminal):
        self.model, self.weights, self.terminal = model, weights, terminal
        self.horizon = jnp.asarray(horizon)
        self.preview = LONGEST

    def prepare(self, reference: Reference) -> AffinePlan:
        """Gain schedule of every step of the reference."""
        steps, position = reference.steps, reference.position
        Q = contour_weight(self.weights.alpha, self.weights.beta, reference.tangent)
        R = control_weight(self.model, self.weights)

        def samples(values, first, count=steps):
            return jax.lax.dynamic_slice_in_dim(values, first, count)

        def sweep(cost, j):
            earlier = one_stage_back(self.model, R, cost, samples(Q, j), samples(position, j))

            def kept(new, old):
                return jnp.where(j < self.horizon, new, old)

            return jax.tree.map(kept, earlier, cost), None

        # the terminal cost from the last two samples of the horizon, as for a horizon of one
        last = self.horizon - 1
        two = samples(Q, last, steps + 1), samples(position, last, steps + 1)
        terminal = self.terminal.cost(self.model, self.weights, *two, slice(1, steps + 1))
        first, _ = jax.lax.scan(sweep, terminal, jnp.arange(self.preview - 1, 0, -1))
        return first_control(self.model, R, first)

    def initial_memory(self, reference: Reference) -> None:
        """No memory: the controller is static."""
        return None

    def step(
        self, memory: None, plan: AffinePlan, measurement: Float[Array, " n"]
    ) -> tuple[None, Float[Array, " p"]]:
        """u = f - F x."""
        return None, plan.f - plan.F @ measurement


class Setup:
    """The table with everything that all runs share.

    Args:
        family: the machines, the nominal one first.
    """

    def __init__(self, family: tuple[Member, ...]):
        self.model = bridgeport()
        self.family = family
        self.motion = eqx.filter_jit(steady_motion)(self.model)
        ends = (OutputTerminal(), RiccatiTerminal(self.motion))
        self.terminals: dict[str, Terminal] = dict(zip(TERMINALS, ends, strict=True))
        gains = [(member.gain_x, member.gain_y) for member in family]
        self.perturbed = [with_input_gains(self.model, pair) for pair in gains]
        delays = [member.delay for member in family]
        depth = max(1, *delays)
        pairs = zip(self.perturbed, delays, strict=True)
        self.machines = stack_plants([_delayed(plant, delay, depth) for plant, delay in pairs])
        self.circle, self.line = _references(self.model.dt)
        # applies the gains of any plan
        self._player = ContouringLQ(self.model, LQWeights(1.0, 0.0, RHO), PREVIEW)

    def plan(self, case: Case, reference: Reference) -> AffinePlan:
        """Gain schedule of a receding-horizon controller."""
        return self._planned(case, self.terminals[case.terminal], reference)

    def plan_holding(self, case: Case, reference: Reference) -> AffinePlan:
        """Gain schedule with H_s, for a path that stops at the end of the preview.

        The Appendix continues the path there.
        """
        standing = SteadyMotion(self.motion.Sy, jnp.zeros_like(self.motion.Sv))
        return self._planned(case, RiccatiTerminal(standing), reference)

    def plan_finite_preview(self, alpha: float, reference: Reference) -> AffinePlan:
        """Gain schedule of Tomizuka & Whitney's controller."""
        return prepared(PreviewLQ(self.model, alpha, RHO, PREVIEW, self.motion), reference)

    def run(self, plan: AffinePlan, reference: Reference) -> FamilyRun:
        """The plan on every machine of the family."""
        metrics, output = _play(self.machines, self._player, plan, reference)
        radius = self.frozen_radius(np.asarray(plan.F)[slice(*WINDOW, RADIUS_STRIDE)])
        return FamilyRun(metrics, radius, np.asarray(output))

    def frozen_radius(self, F: Float[np.ndarray, "T p n"]) -> Float[np.ndarray, " members"]:
        """Largest spectral radius of A - B F on each machine; a delay line is not fed back."""
        pairs = zip(self.perturbed, self.family, strict=True)
        return np.array([_frozen_radius(plant, member.delay, F) for plant, member in pairs])

    def _planned(self, case: Case, terminal: Terminal, reference: Reference) -> AffinePlan:
        weights = LQWeights(case.alpha, case.beta, RHO)
        return prepared(AnyHorizonLQ(self.model, weights, case.preview, terminal), reference)


def family(gain_error: float, delay: int) -> tuple[Member, ...]:
    """The nominal machine, one axis stronger and the other weaker, and delays 1..`delay`."""
    up, down = 1 + gain_error, 1 - gain_error
    late = [Member(1.0, 1.0, samples + 1) for samples in range(delay)]
    return (Member(1.0, 1.0, 0), Member(up, down, 0), Member(down, up, 0), *late)


def radii_on_lines(
    model: LinearPlant, weights: LQWeights, angles: Float[np.ndarray, " D"], longest: int
) -> Float[np.ndarray, "N two D"]:
    """Spectral radius of A - B K on straight lines; axes (horizon, terminal, direction).

    Horizons are 1..`longest`, terminals those of `TERMINALS`. The weights are constant on a line:
    one backward recursion passes through H_1 of every horizon (eqs. 12, 23).
    """
    tangents = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    return spectral_radius(_loops_on_lines(model, weights, tangents, longest))


@eqx.filter_jit
def _loops_on_lines(
    model: LinearPlant, weights: LQWeights, tangents: Float[Array, "D m"], longest: int
) -> Float[Array, "N two D n n"]:
    Q = contour_weight(weights.alpha, weights.beta, tangents)
    R = control_weight(model, weights)
    output = model.C.T @ Q @ model.C
    riccati = RiccatiTerminal().solution(model, weights)
    H = jnp.concatenate([output, jnp.broadcast_to(riccati, output.shape)])
    Q, still = jnp.concatenate([Q, Q]), jnp.zeros((2 * len(tangents), model.axes))

    def back(cost, _):
        loop = model.A[None] - model.B @ first_control(model, R, cost).F
        return one_stage_back(model, R, cost, Q, still), loop

    _, loops = jax.lax.scan(back, CostToGo(H, jnp.zeros(H.shape[:2])), length=longest)
    return loops.reshape(longest, 2, len(tangents), model.states, model.states)


@eqx.filter_jit
def _play(
    machines: Plant, player: Controller, plan: AffinePlan, reference: Reference
) -> tuple[Metrics, Float[Array, "members T m"]]:
    def on_machine(machine: Plant):
        rollout = follow(machine, player, plan, reference)
        return score_signals(rollout.output, rollout.control, reference, WINDOW), rollout.output

    return jax.lax.map(on_machine, machines)


def _references(dt: float) -> tuple[Reference, Reference]:
    """Circle and line, padded alike: they share what is compiled."""
    travelled = FEED * dt * np.arange(STEPS)
    length = FEED * dt * (STEPS + LONGEST)
    straight = line((0.0, 0.0), (length * np.cos(LINE_ANGLE), length * np.sin(LINE_ANGLE)))
    contours = (circle(RADIUS), straight)
    both = stack_references(
        [along(contour, travelled, dt, LONGEST, at_rest=False) for contour in contours]
    )
    return member(both, 0), member(both, 1)


def _delayed(machine: LinearPlant, samples: int, depth: int) -> Plant:
    return Delayed(machine, jnp.asarray(samples), depth, machine.inputs)


def _frozen_radius(machine: LinearPlant, delay: int, F: Float[np.ndarray, "T p n"]) -> float:
    delayed = with_input_delay(machine, delay)
    F = np.pad(F, [(0, 0), (0, 0), (0, delayed.states - machine.states)])
    return float(spectral_radius(np.asarray(delayed.A) - np.asarray(delayed.B) @ F).max())
