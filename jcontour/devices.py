"""Where JAX computes, and what can be computed there."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax
import jax.numpy as jnp


def platform() -> str:
    """Name of the platform that JAX computes on, unless the default device says otherwise."""
    chosen = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return jax.default_backend() if chosen is None else getattr(chosen, "platform", chosen)


def on_gpu() -> bool:
    """Whether a GPU is what JAX computes on, the default of JAX and the default device both."""
    return jax.default_backend() == "gpu" and platform() in ("gpu", "cuda")


@contextmanager
def on_cpu() -> Iterator[None]:
    """Everything within it is computed on the CPU: the kernels of a GPU have a reverse mode only.

    Raises:
        RuntimeError: JAX has been told to do without its CPU (`JAX_PLATFORMS`).
    """
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        yield


def number_size(arrays) -> int | None:
    """Bytes of a number; None where the types are not those of the kernels."""
    types = {jnp.result_type(leaf) for leaf in jax.tree.leaves(arrays)}
    if types not in ({jnp.dtype("float32")}, {jnp.dtype("float64")}):
        return None
    return types.pop().itemsize


def suits_native(*arrays) -> bool:
    """Whether loops compiled for the CPU (`jcontour.native`) take numbers of these types."""
    return platform() == "cpu" and number_size(arrays) == 8


def suits_gpu_code(*arrays) -> bool:
    """Whether our own code for a GPU (`jcontour.native.gpu_code`) takes numbers of these types."""
    return on_gpu() and number_size(arrays) is not None
