"""Yuan, section 2.3: contouring schemes for biaxial machines, tuned alike, on unseen contours.

The section is a survey without numbers of its own. Here all its schemes stand around the same
cascade on a machine of two different flexible axes. First the cascade is tuned. Then every scheme,
the plain cascade among them, descends twice: once from there and once from the thesis's gains. All
descents have the same contours, limits and number of evaluations, on the smooth twin. The
loops have feedback alone, as in the papers of the survey. The tables are of the machine with stick
and slip. Its end effectors are not measured.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.papers import THESIS
from experiments.tables import where
from jcontour import Contour, Controller, Plant, Reference, stack_plants, stack_references
from jcontour.app.catalogue.choices import design_for
from jcontour.app.designs.design import Design
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.families import members
from jcontour.app.machines.flexible_axis import SAMPLE, biaxial_machine, scaled
from jcontour.app.machines.uncertainty import LATE
from jcontour.controllers import CascadeGains
from jcontour.geometry.contours import circle, ellipse, lemniscate, polygon, spline
from jcontour.motion import along, trapezoidal
from jcontour.plants import Delayed, FlexibleAxis, SmoothFlexibleAxis
from jcontour.simulation.closed_loop import follow
from jcontour.simulation.evaluation import one_by_one
from jcontour.simulation.metrics import Metrics, score_signals
from tuning import AtMost, Fixed, Positive, Problem, Tuned, mean_contour_error
from tuning.problem import THOROUGH
from tuning.tuner import Evaluated, TuneState, advance, result

FEED = 0.05  # [m/s]; the thesis asks 0.1 of its axis
ACCELERATION = 1.0  # [m/s^2]; the thesis asks 4 of its axis
SETTLING = 0.2  # [s] that the tool is given, and scored, after its reference has come to the end
# limits of RMS current and of RMS increments, times what the thesis's gains with feedforward need
CURRENT, INCREMENT = 1.2, 2.0
# of the smooth twin while it is tuned: four change its errors by 5e-6; the true plant takes its 20
SUBSTEPS = 2

NOMINAL, *CORNERS, DELAYED = members(stiffness=0.2, mass=0.2)
STIFF, SOFT = (1.2, 0.8), (0.8, 1.2)  # factors on stiffness and on masses
LATE_DRIVES = "one sample late"
MODEL_ERRORS = {  # members of the family of flexible machines
    "nominal": NOMINAL,
    LATE_DRIVES: DELAYED,
    "heavy and soft": next(one for one in CORNERS if (one.stiffness, one.mass) == SOFT),
    "light and stiff": next(one for one in CORNERS if (one.stiffness, one.mass) == STIFF),
}
# without the late one the velocity gains would grow until they ring
TUNED_ON = ("nominal", LATE_DRIVES)
STRONG = 10.0  # times the small gains of a scheme where its cascade is not tuned yet
ONE_DESCENT = replace(THOROUGH, starts=1, scatter=0)  # ended by the budget


def training() -> dict[str, Contour]:
    """A circle, and lines in four directions with corners between them."""
    rhombus = polygon(1e-3 * np.array([[0.0, 0.0], [22.0, 8.0], [30.0, 30.0], [8.0, 22.0]]))
    return {"circle": circle(15e-3), "rhombus": rhombus}


def held_out() -> dict[str, Contour]:
    """Contours that the tuner never sees: other curvatures, directions and a crossing."""
    points = [[0.0, 0.0], [12.0, 16.0], [30.0, -6.0], [48.0, 12.0], [60.0, 0.0]]  # [mm]
    wave = spline(1e-3 * np.array(points))
    return {"ellipse": ellipse(25e-3, 12e-3), "figure of eight": lemniscate(25e-3), "wave": wave}


def run_along(contour: Contour) -> Reference:
    """From rest to rest, and time to settle."""
    arc = trapezoidal(contour, FEED, SAMPLE, ACCELERATION)
    rest = np.full(round(SETTLING / SAMPLE), arc[-1])
    return along(contour, np.append(arc, rest), SAMPLE, 1, at_rest=True)


def references(contours: dict[str, Contour]) -> Reference:
    """References along all of them, stacked."""
    return stack_references([run_along(contour) for contour in contours.values()])


# position and integral time are the thesis's, section 3.4; y has the same bandwidth as x
_FEEDBACK = {
    "position": 30.0 * np.ones(2),
    "velocity": np.array([55.67, 36.9]),
    "integral_time": 0.04 * np.ones(2),
}
_NOTHING = dict.fromkeys(("feedforward", "inertia", "viscous", "coulomb"), np.zeros(2))
START = CascadeGains(**_FEEDBACK, **_NOTHING)
SPACE = (*3 * (Positive(),), *4 * (Fixed(),))
# the limits are those of half of what the motion needs, fed forward
WITH_FEEDFORWARD = CascadeGains(
    **_FEEDBACK,
    feedforward=0.5 * np.ones(2),
    inertia=np.array([0.25, 0.17]),
    viscous=np.array([1.6, 1.25]),
    coulomb=np.array([0.23, 0.21]),
)


class Weights(NamedTuple):
    """Gains of the cascade, and those of the scheme around it."""

    cascade: CascadeGains
    scheme: tuple[Float[Array, ""], ...]


CASCADE, CONSTANT, VARIABLE = "cascade", "cross-coupled, constant", "cross-coupled, variable"
TASK_FRAME, PRECOMPENSATION, SHAPING = "task frame", "pre-compensation", "command shaping"
CATALOGUE = {  # name of a scheme here -> in the catalogue
    CASCADE: "cascade",
    CONSTANT: "cross-coupled",
    VARIABLE: "cross-coupled-variable",
    TASK_FRAME: "task-frame",
    PRECOMPENSATION: "precompensation",
    SHAPING: "command-shaping",
}


@dataclass(frozen=True)
class Row:
    """One scheme on one true machine along one contour; RMS over the run."""

    scheme: str
    contour: str
    training: bool  # whether the tuner saw the contour
    plant: str
    contour_um: float
    peak_um: float
    tracking_um: float
    current_a: float
    increment_a: float
    diverged: bool
    motor_um: float  # contour error at the motors, where the schemes measure


@dataclass(frozen=True)
class Scheme:
    """A scheme of the catalogue around a cascade."""

    design: Design
    names: tuple[str, ...]  # of its own gains; they start small: a tuned cascade is not disturbed

    def build(self, weights: Weights) -> Controller:
        """The scheme with these gains."""
        gains = dict(zip(self.names, weights.scheme, strict=True))
        return self.design.build({**vars(weights.cascade), **gains})

    def around(self, gains: CascadeGains, strength: float = 1.0) -> Weights:
        """First weights, the scheme's own times a factor."""
        start = [strength * self.design.start[name] for name in self.names]
        return Weights(gains, tuple(jnp.asarray(value) for value in start))


def schemes() -> dict[str, Scheme]:
    """All schemes of the survey, the plain cascade first."""
    machine, around = biaxial_machine(), {}
    for name, known in CATALOGUE.items():
        design = design_for(machine, Simulate(controller=known))
        own = [gain for gain in design.start if gain not in CascadeGains.__dataclass_fields__]
        around[name] = Scheme(design, tuple(own))
    return around


def family(names: Sequence[str], smooth: bool) -> Plant:
    """Machines with stick and slip, or their smooth twins, to tune on.

    They have no encoders: the schemes are fed exact positions and speeds.
    """
    nominal, plants = biaxial_machine().parameters, []
    for name in names:
        member = MODEL_ERRORS[name]
        axes = scaled(nominal, member.stiffness, member.mass)
        plant = FlexibleAxis(axes, SAMPLE)
        if smooth:
            plant = SmoothFlexibleAxis(axes, SAMPLE, substeps=SUBSTEPS)
        plants.append(Delayed(plant, jnp.asarray(member.late), LATE, nominal.axes))
    return stack_plants(plants)


class Setup:
    """Machines, contours, limits and evaluations of a descent, the same for every scheme."""

    def __init__(self, budget: int):
        self.plants, self.budget = family(TUNED_ON, smooth=True), budget
        self.references = references(training())
        cascade = schemes()[CASCADE]
        with_feedforward = cascade.build(cascade.around(WITH_FEEDFORWARD))
        start, _ = scored(self.plants, with_feedforward, self.references)
        self.limits = AtMost(
            rms_control=CURRENT * float(jnp.max(start.rms_control)),
            rms_increment=INCREMENT * float(jnp.max(start.rms_increment)),
        )

    def tuned(self, scheme: Scheme, starts: Sequence[Weights]) -> Tuned:
        """The best of one descent from each of these starts."""
        positive = tuple(Positive() for _ in scheme.names)
        space = Weights._make([SPACE, positive])  # constraints in the places of the values
        machines = (self.plants, self.references)
        problem = Problem(scheme.build, *machines, mean_contour_error, space, self.limits)
        history: list[Evaluated] = []
        for start in starts:
            state = TuneState()
            while not state.done and len(state.history) < self.budget:
                state = advance(problem, start, ONE_DESCENT, state)
            history += state.history[: self.budget]
        return result(problem, starts[0], TuneState(history))


@eqx.filter_jit
def scored(plants: Plant, controller: Controller, references: Reference) -> list[Metrics]:
    """Metrics at the end effectors, and at the motors, where the schemes measure.

    Axes (contour, plant).
    """

    def on_contour(reference: Reference):
        plan = controller.prepare(reference)

        def on_plant(plant: Plant):
            run = follow(plant, controller, plan, reference)
            signals = run.output, run.measurement[0]
            return [score_signals(one, run.control, reference) for one in signals]

        return one_by_one(on_plant, plants)

    return one_by_one(on_contour, references)


def rows(name: str, controller: Controller, plants: Sequence[str]) -> list[Row]:
    """The controller on these true machines along every contour."""
    seen, new = training(), held_out()
    true, runs = family(plants, smooth=False), references({**seen, **new})
    tool, motors = scored(true, controller, runs)
    columns = {
        "contour_um": 1e6 * tool.rms_contour_error,
        "peak_um": 1e6 * tool.peak_contour_error,
        "tracking_um": 1e6 * tool.rms_tracking_error,
        "current_a": tool.rms_control,
        "increment_a": tool.rms_increment,
        "diverged": tool.diverged,
        "motor_um": 1e6 * motors.rms_contour_error,
    }
    return [
        Row(
            name, contour, contour in seen, plant, **{c: v[i, j].item() for c, v in columns.items()}
        )
        for i, contour in enumerate((*seen, *new))
        for j, plant in enumerate(plants)
    ]


SOURCE = (
    f"{THESIS}, section 2.3, after Y. Koren (1980), Y. Koren & C.-C. Lo (1991), "
    "J.-H. Chin & T.-C. Lin (1997), C.-C. Lo & C. Y. Chung (1999), "
    "G. T.-C. Chiu & M. Tomizuka (2001), C. S. Chen & L. Y. Chen (2011)"
)
EVALUATIONS, QUICK_EVALUATIONS = 50, 10  # of objective and gradient in one descent


@dataclass(frozen=True)
class TunedScheme:
    """Gains of one scheme, and how its tuning went."""

    scheme: str
    cascade: dict[str, list[float]]
    gains: list[float]  # of the scheme itself
    feasible: bool
    best_um: Sequence[float]  # best feasible objective after every evaluation, the cascade's first


@dataclass(frozen=True)
class Result:
    """How all schemes were tuned, and their runs on the true machines."""

    quick: bool  # too few evaluations for a verdict
    tuning: tuple[TunedScheme, ...]
    rows: tuple[Row, ...]

    def different(self, column: str) -> list[str]:
        """Values of a column of the runs, each once: "scheme" or "plant"."""
        return list(dict.fromkeys(getattr(row, column) for row in self.rows))

    @property
    def schemes(self) -> list[str]:
        """Tuned schemes: all but the cascade before it is tuned."""
        return list(dict.fromkeys(row.scheme for row in self.tuning))

    def mean(self, scheme: str, plant: str, column: str = "contour_um", **which: object) -> float:
        """Mean of a column over runs, which are those of some `training` or `contour`.

        Infinite when a run diverged or has no such number.
        """
        rows = where(self.rows, scheme=scheme, plant=plant, **which)
        values = np.array([getattr(row, column) for row in rows])
        if any(row.diverged for row in rows) or not np.isfinite(values).all():
            return float("inf")
        return float(np.mean(values))


def run(quick: bool = False) -> Result:
    """Tune and simulate everything.

    A scheme is tuned from the tuned cascade and from the thesis's gains.
    """
    plants = TUNED_ON if quick else tuple(MODEL_ERRORS)
    budget = QUICK_EVALUATIONS if quick else EVALUATIONS
    setup, known = Setup(budget), schemes()
    cascade = known[CASCADE]
    first = setup.tuned(cascade, [cascade.around(START)])

    def one(item: tuple[str, Scheme]) -> tuple[TunedScheme, list[Row]]:
        name, scheme = item
        starts = [scheme.around(first.weights.cascade), scheme.around(START, STRONG)]
        tuned = setup.tuned(scheme, starts)
        weights = (vars(tuned.weights.cascade), tuned.weights.scheme)
        gains, own = jax.tree.map(lambda leaf: np.asarray(leaf).tolist(), weights)
        values = [  # [um]
            1e6 * row.objective if row.violation <= 0 and not row.diverged else np.inf
            for row in (*first.history, *tuned.history)
        ]
        best = np.minimum.accumulate(values).tolist()
        described = TunedScheme(name, gains, list(own), tuned.feasible, best)
        return described, rows(name, scheme.build(tuned.weights), plants)

    with ThreadPoolExecutor(2) as pool:  # one compiles while the other descends
        tuning, runs = zip(*pool.map(one, known.items()), strict=True)
    untuned = rows("start", cascade.build(cascade.around(START)), plants)
    return Result(quick, tuning, (*untuned, *chain.from_iterable(runs)))
