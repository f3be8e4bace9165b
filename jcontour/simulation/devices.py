"""A batch spread over devices: several GPUs, the cores of a CPU, or those of several hosts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from jcontour.simulation.evaluation import platform_batching

AXIS = "members"


def device_mesh(count: int | None = None) -> Mesh:
    """The first `count` devices of every host that `jax.distributed` has joined, all of them when not given.

    Raises:
        ValueError: a host has fewer.
    """
    hosts: dict[int, list[Any]] = {}
    for device in jax.devices():
        hosts.setdefault(device.process_index, []).append(device)
    fewest = min(len(owned) for owned in hosts.values())
    if count is not None and not 1 <= count <= fewest:
        raise ValueError(
            f"devices: needs 1 to {fewest}, which is what there is of {jax.default_backend()}, received {count}"
        )
    chosen = [device for owned in hosts.values() for device in owned[:count]]
    return Mesh(np.array(chosen), (AXIS,), axis_types=(AxisType.Auto,))


@dataclass(frozen=True)
class Spread:
    """A `Batching` over the devices of a mesh: every device works through its share as its platform likes it best.

    The batch is filled up to a multiple of the devices with copies of its last member, which are
    cut off again. The results are on every device. A member's numbers do not depend on the device
    that it falls on; sums over members, as in a gradient, are added in another order, which changes
    their rounding.

    Args:
        mesh: see `device_mesh`.
    """

    mesh: Mesh

    def __call__(self, function: Callable, members: Any) -> Any:
        """Results of the function of one member, axis 0 in front."""
        size = jnp.shape(jax.tree.leaves(members)[0])[0]
        short = -size % self.mesh.size
        filled = (
            jax.tree.map(
                lambda leaf: jnp.concatenate([leaf, jnp.repeat(leaf[-1:], short, 0)]), members
            )
            if short
            else members
        )
        shared = PartitionSpec(AXIS)
        share = jax.shard_map(
            lambda part: platform_batching()(function, part),
            mesh=self.mesh,
            in_specs=shared,
            out_specs=shared,
            check_vma=False,
        )
        whole = jax.lax.with_sharding_constraint(
            share(filled), NamedSharding(self.mesh, PartitionSpec())
        )
        return jax.tree.map(lambda leaf: leaf[:size], whole)
