"""Master-slave synchronisation: the slave follows where the master is, not where it should be.

    r_s* = r_s + beta (y_m - r_m),   v_s* = v_s + beta (v_m - dr_m/dt)
With beta = 1 and one reference for both this is the electronic gearbox, r_s* = y_m: the master's
errors are the slave's, those of the slave are its own. beta = 0 leaves the axes to themselves.
Tomizuka et al. (1990) compare their coupling with it: there both axes see each other's errors.
"""

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, checked_gain
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference


class MasterSlave(Controller):
    """A cascade in which one axis follows another.

    Args:
        cascade: the axes.
        pair: the master and the slave.
        coupling: beta, the part of the master's error that the slave takes over.

    Raises:
        ValueError: the pair is not two different axes, or the coupling is negative or not finite.
    """

    cascade: Cascade
    coupling: Float[Array, ""]
    pair: tuple[int, int] = eqx.field(static=True)
    preview: int = eqx.field(static=True, default=1)

    def __init__(self, cascade: Cascade, pair: tuple[int, int] = (0, 1), coupling: ArrayLike = 1.0):
        axes = cascade.sensors.axes
        if len(set(pair)) != 2 or not all(0 <= axis < axes for axis in pair):
            raise ValueError(f"pair: needs two of the {axes} axes, received {pair}")
        self.cascade, self.pair, self.preview = cascade, pair, 1
        self.coupling = checked_gain("coupling", coupling)

    def prepare(self, reference: Reference) -> CascadePlan:
        """Commands of the axes."""
        return self.cascade.prepare(reference)

    def initial_memory(self, reference: Reference) -> Float[Array, " m"]:
        """Integrators of the cascade."""
        return self.cascade.initial_memory(reference)

    def step(
        self, memory: Float[Array, " m"], plan: CascadePlan, measurement
    ) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """Next integrators and the control, both within the limit."""
        (master, slave), cascade = self.pair, self.cascade
        position, velocity = cascade.sensors.read(measurement)
        off = position[master] - plan.position[master]
        faster = velocity[master] - plan.velocity[master]
        command = CascadePlan(
            plan.position.at[slave].add(self.coupling * off),
            plan.velocity.at[slave].add(self.coupling * faster),
            plan.control,
        )
        speed = cascade.speed_command(command, position)
        return cascade.drive(memory, speed - velocity, plan.control)
