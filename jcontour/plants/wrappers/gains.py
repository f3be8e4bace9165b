"""Input gains that a controller does not know."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete
from jcontour.plant import State
from jcontour.wrapper import Remembering


class Gained(Remembering):
    """A plant on which changes of control i act `gains[i]` times as much.

        u_acts(k) = u_0 + gains (u(k) - u_0)
    u_0 holds the plant at rest where the run begins. It is zero where a drive takes a speed or a
    force. A drive that takes a position needs more the farther it is from zero. A machine waits
    where a part begins, and a load observer has found by then what the gain is wrong by there. A
    gain that acts on u_0 as well would begin every run with a jump of (gains - 1) times the place
    of the part. It stands outside of a delay, whose line then holds the controls that act.

    The state keeps u_0 as whole numbers, its bits: it is no part of the loop, and frozen loops
    leave whole numbers as they are. No derivative goes through it.

    >>> from jcontour.linear.plant import LinearPlant
    >>> drive = LinearPlant([[0.9]], [[0.1]], [[1.0]], dt=1e-3)  # takes a position
    >>> plant = Gained(drive, jnp.array([1.5]))
    >>> rest = plant.initial_state(jnp.array([2.0]), jnp.zeros(1))
    >>> for control in (2.0, 3.0):
    ...     print(plant.output(plant.step(rest, jnp.array([control]))).round(9))
    [2.]
    [2.15]

    Args:
        plant: the machine.
        gains: relative, (p,) or one for all.

    Raises:
        ValueError: a gain is not finite and above zero.
    """

    gains: Float[Array, ""] | Float[Array, " p"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        if is_concrete(self.gains):
            gains = np.asarray(self.gains)
            if not np.all(np.isfinite(gains) & (gains > 0)):
                raise ValueError(f"gains: needs to be finite and above zero, received {gains}")

    def initial_state(self, position, increment) -> State:
        """State of the wrapped plant, and the bits of u_0."""
        held = jnp.asarray(self.plant.holding_control(position))
        bits = lax.bitcast_convert_type(held, f"int{8 * held.dtype.itemsize}")
        return self.plant.initial_state(position, increment), bits

    def step(self, state, control) -> State:
        """Step of the wrapped plant under the control that acts."""
        inner, bits = state
        held = lax.bitcast_convert_type(bits, control.dtype)
        return self.plant.step(inner, held + self.gains * (control - held)), bits
