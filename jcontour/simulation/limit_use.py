"""How much of a machine's limits a run uses, axis by axis.

Speed and acceleration are those of the tool, by differences of its samples:

    v(k) = (y(k+1) - y(k)) / dt,   a(k) = (v(k+1) - v(k)) / dt
To the largest a is added the largest that its samples hide, `between_samples`. Both need not occur
at once: what is used is at most this.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour._largest import largest
from jcontour.linear.between_samples import alternating
from jcontour.motion.references import Reference


class AxisLimits(NamedTuple):
    """Greatest magnitudes per axis or input; None where there is no limit.

    Attributes:
        speed: (m,) [m/s].
        acceleration: (m,) [m/s^2].
        control: (p,) [control unit].
        increment: (p,) [control unit per sample].
        hidden: (m, p) acceleration between samples per unit of a control that alternates
            [m/s^2 per control unit], as `hidden_acceleration` gives it; None to leave it out.
    """

    speed: Float[Array | np.ndarray, " m"] | None = None
    acceleration: Float[Array | np.ndarray, " m"] | None = None
    control: Float[Array | np.ndarray, " p"] | None = None
    increment: Float[Array | np.ndarray, " p"] | None = None
    hidden: Float[Array | np.ndarray, "m p"] | None = None


class LimitUse(NamedTuple):
    """Largest |value| / limit over scored samples and axes; 1 is at the limit, 0 without a limit.

    Attributes:
        speed: of the tool.
        acceleration: of the tool.
        control: of the inputs.
        increment: of the inputs' change from sample to sample.
    """

    speed: Float[Array, "*runs"]
    acceleration: Float[Array, "*runs"]
    control: Float[Array, "*runs"]
    increment: Float[Array, "*runs"]


@jax.jit
def limit_use(
    output: Float[Array, "T m"],
    control: Float[Array, "T p"],
    reference: Reference,
    limits: AxisLimits,
) -> LimitUse:
    """Use of the limits by one run.

    >>> import numpy as np
    >>> from jcontour.motion.references import from_samples
    >>> x = jnp.array([[0.0], [1e-3], [3e-3]])  # [m], a sample every millisecond
    >>> path = from_samples(np.asarray(x), np.ones((3, 1)), dt=1e-3, preview=0)
    >>> use = limit_use(x, jnp.array([[1.0], [2.0], [4.0]]), path, AxisLimits(speed=jnp.ones(1)))
    >>> float(use.speed), float(use.control)
    (2.0, 0.0)

    Args:
        output: y [m].
        control: u.
        reference: whose scored samples count; a difference counts where all its samples do.
        limits: those of the machine.
    """
    mask = reference.mask[: reference.steps]
    pairs = mask[1:] & mask[:-1]
    speed = jnp.diff(output, axis=0) / reference.dt
    triples = pairs[1:] & pairs[:-1]
    return LimitUse(
        _largest(speed, pairs, limits.speed),
        _accelerated(jnp.diff(speed, axis=0) / reference.dt, control, triples, limits),
        _largest(control, mask, limits.control),
        _largest(jnp.diff(control, axis=0), pairs, limits.increment),
    )


def _accelerated(
    sampled: Float[Array, "s m"],
    control: Float[Array, "T p"],
    counted: Bool[Array, " s"],
    limits: AxisLimits,
) -> Float[Array, ""]:
    """Use by what the samples show and, where it is looked at, by what they hide."""
    if limits.acceleration is None or limits.hidden is None:
        return _largest(sampled, counted, limits.acceleration)
    hidden = alternating(control) @ limits.hidden.T
    most = [largest(jnp.where(counted[:, None], jnp.abs(part), 0)) for part in (sampled, hidden)]
    return largest(jnp.asarray(sum(most) / limits.acceleration))


def _largest(
    values: Float[Array, "T d"],
    counted: Bool[Array, " T"],
    limit: Float[Array | np.ndarray, " d"] | None,
) -> Float[Array, ""]:
    if limit is None:
        return jnp.zeros((), values.dtype)
    return largest(jnp.where(counted[:, None], jnp.abs(values) / limit[None], 0.0).ravel())
