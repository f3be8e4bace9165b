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
    """Mesh of the first `count` devices of every host that `jax.distributed` has joined.

    Without `count` it has all of them.

    Raises:
        ValueError: a host has fewer.
    """
    hosts: dict[int, list[Any]] = {}
    for device in jax.devices():
        hosts.setdefault(device.process_index, []).append(device)
    fewest = min(len(owned) for owned in hosts.values())
    if count is not None and not 1 <= count <= fewest:
        raise ValueError(
            f"devices: needs 1 to {fewest}, which is what there is of {jax.default_backend()}, "
            f"received {count}"
        )
    chosen = [device for owned in hosts.values() for device in owned[:count]]
    return Mesh(np.array(chosen), (AXIS,), axis_types=(AxisType.Auto,))


@dataclass(frozen=True)
class Spread:
    """A `Batching` over the devices of a mesh.

    Every device works through its share in the way that is fastest on its platform. The batch is
    filled up to a multiple of the devices with copies of its last member, which are cut off again.
    The results are on every device. A member's numbers do not depend on the device that it falls
    on; sums over members, as in a gradient, are added in another order, which changes their
    rounding.

    Args:
        mesh: see `device_mesh`.
    """

    mesh: Mesh

    def __call__(self, function: Callable, members: Any) -> Any:
        """Results of a function of one member, for every member, on axis 0."""
        size = jnp.shape(jax.tree.leaves(members)[0])[0]
        short = -size % self.mesh.size

        def filled(leaf):
            return jnp.concatenate([leaf, jnp.repeat(leaf[-1:], short, 0)])

        def share(part):
            return platform_batching()(function, part)

        spread = PartitionSpec(AXIS)
        on_devices = jax.shard_map(
            share, mesh=self.mesh, in_specs=spread, out_specs=spread, check_vma=False
        )
        results = on_devices(jax.tree.map(filled, members) if short else members)
        everywhere = NamedSharding(self.mesh, PartitionSpec())
        whole = jax.lax.with_sharding_constraint(results, everywhere)
        return jax.tree.map(lambda leaf: leaf[:size], whole)
