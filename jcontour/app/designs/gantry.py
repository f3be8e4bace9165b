"""Controllers of gantries as the commands see them.

They are a cascade of each motor, and contouring LQ on one model or on those along the path.
"""

import jax.numpy as jnp

from jcontour.app.designs.design import Design, Gains, Needs, picked
from jcontour.app.machines.gantry import GantryMachine
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.pole_placement import SelfTuning, placed_gains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal, balanced
from jcontour.controllers.lq.scheduled_lq import ScheduledLQ
from jcontour.controllers.wrappers.adapters import OfMotors
from jcontour.controllers.wrappers.filters import Compensated
from jcontour.plants.gantry.feedback_linearisation import EncoderLinearisation
from jcontour.sensors import motors
from tuning.parameters import Weight

MOTORS = jnp.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])  # both drives follow y
POLES = (0.975, 0.97)  # of the self-tuning loop, in z: 25 and 30 rad/s at 1 ms
VARIANCE = 0.01  # [1/A^2] some tens of amperes teach the gain; a count of the encoder does not


GANTRY = Needs("a gantry", GantryMachine)


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
        "a gantry with dry friction", GantryMachine, lambda gantry: gantry.friction is not None
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
        return ContouringLQ(model, self.cost(weights), self.flags.preview, RiccatiTerminal())

    @staticmethod
    def cost(weights: Gains) -> LQWeights:
        """Weights of the cost, the drives kept from fighting each other."""
        balance = balanced(1.0, 3, 1, 2, weights["difference"])
        return LQWeights(weights["alpha"], weights["beta"], balance)


class GantryScheduledLQ(GantryLQ):
    """Contouring LQ on three motors, its models those along the path."""

    def build(self, weights: Gains) -> Controller:
        return ScheduledLQ(self.machine.schedule, self.cost(weights), self.flags.preview)


class GantryLinearisedLQ(GantryLQ):
    """The same, the coupling of head and beam cancelled by feedback (Yuan).

    The nominal coupling is cancelled, as in section 5.4.2.
    """

    def build(self, weights: Gains) -> Controller:
        schedule = self.machine.linearised_schedule
        inner = ScheduledLQ(schedule, self.cost(weights), self.flags.preview)
        return Compensated(inner, EncoderLinearisation(self.machine.parameters))


class GantrySelfTuning(Design[GantryMachine]):
    """Servo of each motor that learns its input gain (Astrom & Wittenmark).

    The first input gain is the mean of those of the axes.
    """

    needs = Needs(
        "a gantry without dry friction", GantryMachine, lambda gantry: gantry.friction is None
    )
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
