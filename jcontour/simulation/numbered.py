"""Equal plants without arrays of their own, told apart by a number."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Int

from jcontour.wrapper import Wrapper


class Numbered(Wrapper):
    """A plant and a number that nothing reads.

    All fields of a plant may be static. Then a family of equal ones has no array whose axis 0
    counts them: their numbers do.

    >>> from jcontour.linear.plant import LinearPlant
    >>> drive = LinearPlant([[1.0]], [[1e-3]], [[1.0]], dt=1e-3)
    >>> Numbered(drive, 2).step(jnp.ones(1), jnp.ones(1)).tolist()
    [1.001]

    Args:
        plant: the machine.
        number: of the member, or (members,) of a family.
    """

    number: Int[Array, ""] | Int[Array, " members"] = eqx.field(converter=jnp.asarray)
