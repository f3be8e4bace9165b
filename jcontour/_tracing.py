"""Numbers that the host can look at, told from tracers inside a JAX transformation."""

from jax.core import Tracer


def is_concrete(*values) -> bool:
    """Whether every value is a number that the host can look at, none a tracer."""
    return not any(isinstance(value, Tracer) for value in values)
