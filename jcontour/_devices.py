"""Where JAX computes, and what can be computed there."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax


def platform() -> str:
    """Name of the platform that JAX computes on, unless the default device says otherwise."""
    chosen = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return jax.default_backend() if chosen is None else getattr(chosen, "platform", chosen)


def on_gpu() -> bool:
    """Whether a GPU is what JAX computes on, the default of JAX and the default device both."""
    return jax.default_backend() == "gpu" and platform() in ("gpu", "cuda")


@contextmanager
def on_cpu() -> Iterator[None]:
    """Everything within it is computed on the CPU: what is few and small is faster there.

    Raises:
        RuntimeError: JAX has been told to do without its CPU (`JAX_PLATFORMS`).
    """
    if platform() == "cpu":  # else every program within it would be traced once more
        yield
        return
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        yield
