"""Controllers of gantries as the commands see them.

They are a cascade of each motor, and contouring LQ on one model or on those along the path.
"""

from collections.abc import Callable
from functools import partial

import jax.numpy as jnp

from jcontour.app.designs.gains import Gain, GainDesign, Gains
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.gantry import GantryMachine
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal, balanced
from jcontour.controllers.lq.scheduled_lq import ScheduledLQ
from jcontour.controllers.wrappers.compensated import Compensated
from jcontour.controllers.wrappers.motor_kinematics import OfMotors
from jcontour.plants.gantry.feedback_linearisation import EncoderLinearisation
from jcontour.sensors import motors

MOTORS = jnp.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])  # both drives follow y
GainSet = Callable[[GantryMachine], dict[str, Gain]]
# the last argument is the preview, which a cascade has no use for
MakeController = Callable[[GantryMachine, Gains, int], Controller]


def loops(machine: GantryMachine) -> dict[str, Gain]:
    """Gains of X and Y, the same for both drives of Y; feedforward is by the model.

    The velocity loop is at 100 rad/s, the position loop at 30 rad/s.
    """
    p = machine.parameters
    inertia = jnp.stack([p.head_mass / p.head_constant, p.total_mass / (2 * p.drive_constant)])
    viscous = jnp.stack([p.head_viscous / p.head_constant, p.drive_viscous / p.drive_constant])
    return {
        "position": Gain(jnp.full(2, 30.0), "1/s"),
        "velocity": Gain(100 * inertia, "A s/m"),
        "integral_time": Gain(jnp.full(2, 0.05), "s"),
        "feedforward": Gain(jnp.ones(2), ""),
        "inertia": Gain(inertia, "A s^2/m"),
        "viscous": Gain(viscous, "A s/m"),
    }


def loops_and_dry_friction(machine: GantryMachine) -> dict[str, Gain]:
    """The same, and the dry friction of the guide ways at rest; of Y the mean of both drives."""
    assert machine.friction is not None  # the catalogue has it for no other
    head, first, second = machine.friction.dry(jnp.zeros(3))
    p = machine.parameters
    dry = jnp.stack([head / p.head_constant, (first + second) / (2 * p.drive_constant)])
    return {**loops(machine), "coulomb": Gain(dry, "A")}


def quadratic(machine: GantryMachine) -> dict[str, Gain]:
    """Weights of errors and of the drives' difference beside an ampere in each motor.

    An ampere weighs as much as a tenth of a millimetre of lag, as a thirtieth off the contour, and
    as an ampere between the drives.
    """
    return {
        "alpha": Gain(1e8, "A^2/m^2", cost=True),
        "beta": Gain(1e9, "A^2/m^2", cost=True),
        "difference": Gain(1.0, ""),
    }


def cascade(machine: GantryMachine, gains: Gains, preview: int) -> OfMotors:
    """P-PI for each of the three motors by itself.

    The integrators know the limits of the machine's currents.
    """
    each = {name: MOTORS @ value for name, value in gains.items()}
    limit = jnp.asarray(machine.limits.control)
    loops_of_motors = Cascade(CascadeGains(**each), motors(3), machine.model.dt, limit)
    return OfMotors(loops_of_motors, MOTORS)


def contouring_lq(machine: GantryMachine, gains: Gains, preview: int) -> ContouringLQ:
    """Contouring LQ on the model with the head at the centre of the beam."""
    return ContouringLQ(machine.model, lq_weights(gains), preview, RiccatiTerminal())


def scheduled_lq(machine: GantryMachine, gains: Gains, preview: int) -> ScheduledLQ:
    """Contouring LQ on the models along the path."""
    return ScheduledLQ(machine.schedule, lq_weights(gains), preview)


def feedback_linearised_lq(machine: GantryMachine, gains: Gains, preview: int) -> Compensated:
    """Contouring LQ on the models along the path, the coupling of head and beam cancelled.

    The nominal coupling is cancelled, as in Yuan, section 5.4.2.
    """
    return Compensated(
        ScheduledLQ(machine.linearised_schedule, lq_weights(gains), preview),
        EncoderLinearisation(machine.parameters),
    )


def gantry_design(
    make: MakeController, gain_set: GainSet
) -> Callable[[str, str, GantryMachine, Controlled], GainDesign]:
    """Maker of a design from the gains that its controller takes."""

    def design(name: str, line: str, machine: GantryMachine, flags: Controlled) -> GainDesign:
        gains = gain_set(machine)
        start = {key: gain.start for key, gain in gains.items()}
        space = {key: gain.parameter for key, gain in gains.items()}
        build = partial(_built, make, flags.preview)
        preview = build(machine, start).preview
        return GainDesign(name, machine, start, space, preview, "outputs", build, line, gains)

    return design


def _built(make: MakeController, preview: int, machine: GantryMachine, gains: Gains) -> Controller:
    return make(machine, gains, preview)


def lq_weights(gains: Gains) -> LQWeights:
    """Weights of the cost, the drives kept from fighting each other."""
    return LQWeights(gains["alpha"], gains["beta"], balanced(1.0, 3, 1, 2, gains["difference"]))
