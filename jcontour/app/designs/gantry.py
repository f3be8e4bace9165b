"""Controllers of gantries as the commands see them.

They are a cascade of each motor, and contouring LQ on one model or on those along the path.
"""

from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.designs.design import Design, Drift, Gains, Needs, picked
from jcontour.app.designs.first_loop import STATES
from jcontour.app.machines.gantry import MOTORS as SHARES
from jcontour.app.machines.gantry import GantryMachine
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.pole_placement import SelfTuning, placed_gains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal, balanced
from jcontour.controllers.lq.scheduled_lq import ScheduledLQ
from jcontour.controllers.observers.kalman import OffsetFreeObserver, offset_free_gain
from jcontour.controllers.wrappers.adapters import OfMotors
from jcontour.controllers.wrappers.filters import Compensated
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.gantry.feedback_linearisation import EncoderLinearisation
from jcontour.sensors import motors
from tuning.parameters import Weight

MOTORS = jnp.asarray(SHARES)  # gains of X and Y to those of the three motors
POLES = (0.975, 0.97)  # of the self-tuning loop, in z: 25 and 30 rad/s at 1 ms
VARIANCE = 0.01  # [1/A^2] some tens of amperes teach the gain; a count of the encoder does not


GANTRY = Needs("a gantry", "gantry")


def _inertia(machine: GantryMachine):
    p = machine.parameters
    return jnp.stack([p.head_mass / p.head_constant, p.total_mass / (2 * p.drive_constant)])


def _viscous(machine: GantryMachine):
    p = machine.parameters
    return jnp.stack([p.head_viscous / p.head_constant, p.drive_viscous / p.drive_constant])


def _dry(machine: GantryMachine):
    """Current that the guide ways take at rest, of Y the mean of both drives; none without them."""
    if machine.friction is None:
        return None
    head, first, second = machine.friction.dry(jnp.zeros(3))
    p = machine.parameters
    return jnp.stack([head / p.head_constant, (first + second) / (2 * p.drive_constant)])


LOOPS = (  # gains of X and Y, the same for both drives of Y
    Weight("position", "1/s", start=jnp.full(2, 30.0)),
    Weight("velocity", "A s/m", start=lambda machine: 100 * _inertia(machine)),
    Weight("integral_time", "s", start=jnp.full(2, 0.05)),
)
DRY_FRICTION = Weight("coulomb", "A", start=_dry)


class GantryCascade(Design[GantryMachine]):
    """P-PI cascade of each motor, fed speed and acceleration.

    The velocity loop is at 100 rad/s, the position loop at 30 rad/s, feedforward is by the model.
    The integrators know the limits of the machine's currents.
    """

    needs = GANTRY
    weights = (
        *LOOPS,
        Weight("feedforward", start=jnp.ones(2)),
        Weight("inertia", "A s^2/m", start=_inertia),
        Weight("viscous", "A s/m", start=_viscous),
    )

    def build(self, weights: Gains) -> Controller:
        return OfMotors(self.cascade(weights), MOTORS)

    def cascade(self, gains: Gains) -> Cascade:
        """The cascades of the three motors."""
        each = {name: MOTORS @ value for name, value in gains.items()}
        limit = jnp.asarray(self.machine.limits.control)
        return Cascade(CascadeGains(**each), motors(3), self.machine.model.dt, limit)


class GantryFrictionCascade(GantryCascade):
    """P-PI cascade of each motor, fed speed, acceleration and dry friction."""

    needs = Needs(
        "a gantry with dry friction", "gantry", lambda gantry: gantry.friction is not None
    )
    weights = (*GantryCascade.weights, DRY_FRICTION)


class GantryLQ(Design[GantryMachine]):
    """Contouring LQ on three motors, its model that of the beam's centre.

    An ampere in each motor weighs as much as a tenth of a millimetre of lag, as a thirtieth off the
    contour, and as an ampere between the drives of Y.
    """

    needs = GANTRY
    weights = (
        Weight("alpha", "A^2/m^2", start=1e8, cost=True),
        Weight("beta", "A^2/m^2", start=1e9, cost=True),
        Weight("difference", start=1.0),
    )
    reads = ("preview",)

    def build(self, weights: Gains) -> Controller:
        model = self.machine.model
        return ContouringLQ(
            model, self.cost(weights), self.flags.horizon(self.machine.model.dt), RiccatiTerminal()
        )

    @staticmethod
    def cost(weights: Gains) -> LQWeights:
        """Weights of the cost, the drives kept from fighting each other."""
        balance = balanced(1.0, 3, 1, 2, weights["difference"])
        return LQWeights(weights["alpha"], weights["beta"], balance)


class GantryScheduledLQ(GantryLQ):
    """Contouring LQ on three motors, its models those along the path."""

    def build(self, weights: Gains) -> Controller:
        return ScheduledLQ(
            self.machine.schedule, self.cost(weights), self.flags.horizon(self.machine.model.dt)
        )


class GantryLinearisedLQ(GantryLQ):
    """The same, the coupling of head and beam cancelled by feedback (Yuan).

    The nominal coupling is cancelled, as in section 5.4.2.
    """

    def build(self, weights: Gains) -> Controller:
        schedule = self.machine.linearised_schedule
        inner = ScheduledLQ(schedule, self.cost(weights), self.flags.horizon(self.machine.model.dt))
        return Compensated(inner, EncoderLinearisation(self.machine.parameters))


class GantrySelfTuning(Design[GantryMachine]):
    """Servo of each motor that learns its input gain (Astrom & Wittenmark).

    The first input gain is the mean of those of the axes.
    """

    needs = Needs("a gantry without dry friction", "gantry", lambda gantry: gantry.friction is None)
    weights = (Weight("position"), Weight("rate"))
    learns = True

    def starts(self) -> Gains:
        return dict(zip(("position", "rate"), placed_gains(*POLES), strict=True))

    def build(self, weights: Gains) -> Controller:
        p, dt = self.machine.parameters, self.machine.model.dt
        head, drives = p.head_constant / p.head_mass, 2 * p.drive_constant / p.total_mass
        first = float(head + drives) / 2 * dt**2 / 2
        gains = picked("position rate", weights)
        return OfMotors(SelfTuning(*gains, motors(3), first, VARIANCE, forgetting=1.0), MOTORS)


COUNT = 3  # of motors
# [rad per sample] of the load's estimate: the regulator is faster, so that the observer alone
# decides the margin; the beam's twist, at 0.55, is left alone. A faster one exceeds the usual bound
# on the peak sensitivity, 2, where masses are off by a tenth
BANDWIDTH = 0.033
# [A^2/m^2] of lag and of contour error beside an ampere: a regulator with more of the first is
# faster, and leaves the observer more of the margin
ALPHA, BETA = 7e8, 2e8


def _noise(machine: GantryMachine) -> float:
    """Noise of the controls whose observer crosses over at the bandwidth by itself."""
    # gain of the slower axis from current to position: the last of three is that of the twist
    A, B = np.asarray(machine.model.A), np.asarray(machine.model.B)
    G = np.linalg.solve(np.exp(1j * BANDWIDTH) * np.eye(len(A)) - A, B)[:COUNT]
    return rounding(machine) / float(np.linalg.svd(G, compute_uv=False)[1])


class GantryOffsetFreeLQ(GantryLQ):
    """Contouring LQ on three motors, behind an observer that predicts and finds the load.

    As in the first loops of linear machines, drift / rounding = w / |G(w)| at the bandwidth w. The
    model predicts over all of the unknown delay where none is given.
    """

    weights = (
        Weight("alpha", "A^2/m^2", start=ALPHA, cost=True),
        Weight("beta", "A^2/m^2", start=BETA, cost=True),
        GantryLQ.weights[2],
        Weight("control_noise", "A", start=lambda machine: STATES * _noise(machine)),
        Weight("drift", "A per sample", Drift(), lambda machine: BANDWIDTH * _noise(machine)),
    )
    reads = ("preview", "model_delay")

    @cached_property
    def late(self) -> int:
        """Samples of the unknown delay that the model predicts over."""
        most = self.machine.unknown_delay
        return self.model_delay(most, most)

    @cached_property
    def model(self) -> LinearPlant:
        """Model with the delay; never traced: its zeros are known while it is built."""
        with jax.ensure_compile_time_eval():
            return with_input_delay(self.machine.model, self.late)

    def first_preview(self, first: Gains) -> int:
        return self.flags.horizon(self.machine.model.dt)

    def settings(self) -> dict[str, int]:
        return {**super().settings(), "model_delay": self.late}

    def build(self, weights: Gains) -> Controller:
        model, cost = self.model, self.cost(weights)
        # Gain on the motors' positions; their speeds are differences and tell nothing more
        noises = weights["control_noise"], weights["drift"]
        positions = jnp.eye(COUNT, model.states)
        gain = offset_free_gain(model, positions, *noises, rounding(self.machine))
        return OffsetFreeObserver(
            controller=ContouringLQ(
                model, cost, self.flags.horizon(self.machine.model.dt), RiccatiTerminal()
            ),
            model=model,
            gain=jnp.concatenate([gain, jnp.zeros_like(gain)], axis=1),
            measured=jnp.eye(2 * COUNT, model.states),
            limit=jnp.asarray(self.machine.limits.control),
        )


def rounding(machine: GantryMachine) -> float:
    """Standard deviation [m] of what counts round off."""
    return float(machine.resolution / np.sqrt(12))
