"""McNab & Tsao 2000: receding-horizon LQ contouring on an X-Y table, every table, figure, theorem.

Only their simulated figures can be reproduced. Table 1 and Figs 3, 5, 7, 8 were measured on the
machine: our simulation is shown beside them and not fitted to them. At high weights the machine
behaves otherwise than their simulation. We look for the reason in a family of machines with an
input delay and input gains that the controller does not know.
"""

from dataclasses import dataclass
from itertools import product

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour import Controller, LinearPlant, Plant, Reference, stack_plants, stack_references
from jcontour.controllers import ContouringLQ, LQWeights, OutputTerminal, PreviewLQ, RiccatiTerminal
from jcontour.controllers.lq.contouring_lq import Terminal, contour_weight, control_weight
from jcontour.geometry.contours import circle, line
from jcontour.linear import with_input_gains
from jcontour.linear.plant import AffinePlan, SteadyMotion, spectral_radius, steady_motion
from jcontour.linear.transformations import with_input_delay
from jcontour.motion import along
from jcontour.plants import Delayed, bridgeport
from jcontour.riccati.receding_horizon import CostToGo, first_control, one_stage_back
from jcontour.simulation.closed_loop import follow, prepared
from jcontour.simulation.evaluation import member
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

    name: str  # in a legend
    gain_x: float
    gain_y: float
    delay: int


FAMILY = (  # the nominal machine, one axis stronger and the other weaker, delays
    Member("nominal", 1.0, 1.0, 0),
    Member("gains x 1.1, y 0.9", 1.1, 0.9, 0),
    Member("gains x 0.9, y 1.1", 0.9, 1.1, 0),
    Member("delay 1", 1.0, 1.0, 1),
    Member("delay 2", 1.0, 1.0, 2),
)


@dataclass(frozen=True)
class MachineRun:
    """One run on one machine; errors are not finite where it diverges. RMS over the scored lap."""

    spectral_radius: float  # largest of the frozen loops
    diverged: bool
    te_um: float  # tracking error
    ce_um: float  # contour error
    projected_um: float  # contour error by the paper's eq. 3

    @property
    def stable(self) -> bool:
        """Whether all frozen loops are."""
        return self.spectral_radius < 1


@dataclass(frozen=True)
class CaseRun:
    """One controller on the whole family, the nominal machine first."""

    case: Case
    machines: tuple[MachineRun, ...]


@eqx.filter_jit
def any_horizon(
    model: LinearPlant,
    weights: LQWeights,
    horizon: Int[Array, ""],
    terminal: Terminal,
    reference: Reference,
) -> AffinePlan:
    """Gains of `ContouringLQ` whose horizon is an array: all horizons share one compilation.

    The horizon is between 1 and `LONGEST`. The backward sweep starts at the longest horizon and
    leaves the terminal cost as it is until j < horizon.
    """
    steps, position = reference.steps, reference.position
    Q = contour_weight(weights.alpha, weights.beta, reference.tangent)
    R = control_weight(model, weights)

    def samples(values, first, count=steps):
        return jax.lax.dynamic_slice_in_dim(values, first, count)

    def sweep(cost, j):
        earlier = one_stage_back(model, R, cost, samples(Q, j), samples(position, j))
        return jax.tree.map(lambda new, old: jnp.where(j < horizon, new, old), earlier, cost), None

    # the terminal cost from the last two samples of the horizon, as for a horizon of one
    two = samples(Q, horizon - 1, steps + 1), samples(position, horizon - 1, steps + 1)
    end = terminal.cost(model, weights, *two, slice(1, steps + 1))
    first, _ = jax.lax.scan(sweep, end, jnp.arange(LONGEST - 1, 0, -1))
    return first_control(model, R, first)


class Setup:
    """The table with everything that all runs share."""

    def __init__(self):
        self.model = bridgeport()
        self.motion = eqx.filter_jit(steady_motion)(self.model)
        ends = (OutputTerminal(), RiccatiTerminal(self.motion))
        self.terminals: dict[str, Terminal] = dict(zip(TERMINALS, ends, strict=True))
        gains = [(member.gain_x, member.gain_y) for member in FAMILY]
        self.perturbed = [with_input_gains(self.model, pair) for pair in gains]
        delays = [member.delay for member in FAMILY]
        depth = max(1, *delays)
        pairs = zip(self.perturbed, delays, strict=True)
        self.machines = stack_plants(
            [Delayed(plant, jnp.asarray(delay), depth, plant.inputs) for plant, delay in pairs]
        )
        travelled = FEED * self.model.dt * np.arange(STEPS)
        length = FEED * self.model.dt * (STEPS + LONGEST)
        straight = line((0.0, 0.0), (length * np.cos(LINE_ANGLE), length * np.sin(LINE_ANGLE)))
        both = [  # padded alike: they share what is compiled
            along(contour, travelled, self.model.dt, LONGEST, at_rest=False)
            for contour in (circle(RADIUS), straight)
        ]
        self.circle, self.line = (member(stack_references(both), place) for place in (0, 1))
        # applies the gains of any plan
        self._player = ContouringLQ(self.model, LQWeights(1.0, 0.0, RHO), PREVIEW)

    def plan(
        self, case: Case, reference: Reference, terminal: Terminal | None = None
    ) -> AffinePlan:
        """Gain schedule of a receding-horizon controller, maybe with another terminal."""
        weights = LQWeights(case.alpha, case.beta, RHO)
        end = self.terminals[case.terminal] if terminal is None else terminal
        return any_horizon(self.model, weights, jnp.asarray(case.preview), end, reference)

    def run(
        self, plan: AffinePlan, reference: Reference
    ) -> tuple[tuple[MachineRun, ...], Float[np.ndarray, "T m"]]:
        """The plan on every machine of the family, and the output of the nominal one."""
        metrics, output = _play(self.machines, self._player, plan, reference)
        radii = self.frozen_radius(np.asarray(plan.F)[slice(*WINDOW, RADIUS_STRIDE)])
        errors = metrics.rms_tracking_error, metrics.rms_contour_error, metrics.rms_projected_error
        lost = np.asarray(metrics.diverged)
        rows = np.where(lost, np.inf, 1e6 * np.array(errors)).T.tolist()
        machines = tuple(
            MachineRun(float(radius), bool(diverged), *row)
            for radius, diverged, row in zip(radii, lost, rows, strict=True)
        )
        return machines, np.asarray(output)[0]

    def frozen_radius(self, F: Float[np.ndarray, "T p n"]) -> Float[np.ndarray, " members"]:
        """Largest spectral radius of A - B F on each machine; a delay line is not fed back."""
        radii = []
        for plant, one in zip(self.perturbed, FAMILY, strict=True):
            delayed = with_input_delay(plant, one.delay)
            gains = np.pad(F, [(0, 0), (0, 0), (0, delayed.states - plant.states)])
            loops = np.asarray(delayed.A) - np.asarray(delayed.B) @ gains
            radii.append(float(spectral_radius(loops).max()))
        return np.array(radii)


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


SOURCE = (
    "R. J. McNab, T.-C. Tsao: Receding Time Horizon Linear Quadratic Optimal Control for "
    "Multi-Axis Contour Tracking Motion Control. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 122 (2000)"
)
# the paper's weights and what lies between
ALPHAS, BETAS = (0.25, 0.5, 1.2, 3.0, 4.0, 8.0), (0.0, 1.0, 5.0, 15.0, 20.0)
TOO_HIGH_ALPHA = 20.0  # beyond the paper's, for the U-shape
FIGURE_2_ALPHA = 1.2  # the largest at which the points of Fig. 2 still differ by eye
FIGURE_9, FIGURE_10 = (4.0, 0.0), (0.25, 15.0)  # the paper's alpha, beta
LINE_ALPHA, LINE_BETAS = 3.0, (0.0, 1.0, 5.0, 20.0)  # 3/0 -> 3/5
LINE_SCALES = (1.0, 10.0)  # and the same at ten times the weights
POINTS = slice(591, 602)  # samples near the circle's upper left, in the scored lap
THEOREM_WEIGHTS = tuple(  # alpha, beta, rho
    product((0.25, 3.0, 8.0), (0.0, 5.0, 15.0, 20.0), (RHO, RHO * 1e-2, RHO * 1e-4))
)
THEOREM_HORIZON = 50
# over half a turn: the weight is that of the opposite direction
THEOREM_DIRECTIONS, QUICK_DIRECTIONS = 72, 18


@dataclass(frozen=True)
class Result:
    """Runs on the circle and the line, Fig. 2, finite preview, and Theorem 1."""

    circle: tuple[CaseRun, ...]
    line: tuple[CaseRun, ...]
    desired_m: Float[np.ndarray, "S 2"]  # samples of Fig. 2
    output_m: dict[str, Float[np.ndarray, "S 2"]]  # the same, by beta
    finite_preview: dict[str, MachineRun]  # beside case III, with and without the Appendix
    largest_gain_difference: float  # between the first two of them, relative
    directions: int  # of the straight lines
    # largest spectral radius over all directions, for the sets of weights of Theorem 1
    radii: Float[np.ndarray, "sets terminals horizons"]

    def on_family(self, *case) -> tuple[MachineRun, ...]:
        """Runs of one controller on the circle: terminal, alpha, beta and maybe preview."""
        return next(run.machines for run in self.circle if run.case == Case(*case))

    def over_weights(self, terminal: str, error: str) -> Float[np.ndarray, "alphas betas"]:
        """One error on the nominal machine over the weight grid."""
        values = [
            getattr(self.on_family(terminal, *pair)[0], error) for pair in product(ALPHAS, BETAS)
        ]
        return np.reshape(values, (len(ALPHAS), len(BETAS)))

    def over_previews(
        self, terminal: str, weights: tuple[float, float], error: str
    ) -> dict[int, float]:
        """One error on the nominal machine by the preview length."""
        lengths = range(1, LONGEST + 1)
        return {n: getattr(self.on_family(terminal, *weights, n)[0], error) for n in lengths}


def run(quick: bool = False) -> Result:
    """Simulate everything."""
    setup = Setup()
    cases = [Case(*case) for case in product(TERMINALS, ALPHAS, BETAS)]
    cases += [Case(terminal, TOO_HIGH_ALPHA, 0.0) for terminal in TERMINALS]
    scans = product((FIGURE_9, FIGURE_10), TERMINALS, range(1, LONGEST + 1))
    cases += [Case(terminal, *weights, preview) for weights, terminal, preview in scans]
    circle, outputs = [], {}
    for case in dict.fromkeys(cases):  # N_p = 10 is in both
        machines, output = setup.run(setup.plan(case, setup.circle), setup.circle)
        circle.append(CaseRun(case, machines))
        if case == Case("output", FIGURE_2_ALPHA, case.beta):
            outputs[f"{case.beta:g}"] = output[POINTS]
    line = []
    for terminal, scale, beta in product(TERMINALS, LINE_SCALES, LINE_BETAS):
        case = Case(terminal, scale * LINE_ALPHA, scale * beta)
        line.append(CaseRun(case, setup.run(setup.plan(case, setup.line), setup.line)[0]))
    case_iii = Case("dare", 3.0, 0.0)
    # the Appendix continues the path at the end of the preview: here it stops there
    standing = RiccatiTerminal(SteadyMotion(setup.motion.Sy, jnp.zeros_like(setup.motion.Sv)))
    finite = PreviewLQ(setup.model, case_iii.alpha, RHO, PREVIEW, setup.motion)
    plans = {
        "finite preview": prepared(finite, setup.circle),
        "case III": setup.plan(case_iii, setup.circle),
        "case III, path held": setup.plan(case_iii, setup.circle, standing),
    }
    ours, theirs, _ = plans.values()
    directions = QUICK_DIRECTIONS if quick else THEOREM_DIRECTIONS
    angles = np.deg2rad(np.arange(directions) * 180.0 / directions)
    radii = [
        radii_on_lines(setup.model, LQWeights(*weights), angles, THEOREM_HORIZON).max(axis=2).T
        for weights in THEOREM_WEIGHTS
    ]
    return Result(
        circle=tuple(circle),
        line=tuple(line),
        desired_m=np.asarray(setup.circle.position[POINTS]),
        output_m=outputs,
        finite_preview={name: setup.run(plan, setup.circle)[0][0] for name, plan in plans.items()},
        largest_gain_difference=max(
            float(np.max(np.abs(a - b)) / np.max(np.abs(b)))
            for a, b in ((ours.F, theirs.F), (ours.f, theirs.f))
        ),
        directions=directions,
        radii=np.array(radii),
    )
