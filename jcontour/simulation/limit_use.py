"""How much of a machine's limits a run uses, axis by axis.

Speed and acceleration are those of the tool, by differences of its samples:

    v(k) = (y(k+1) - y(k)) / dt,   a(k) = (v(k+1) - v(k)) / dt
To the largest a is added the largest that its samples hide. Both need not occur at once: what is
used is at most this.

A held control that alternates from sample to sample lets the tool swing at half the sampling rate.
A sampled double integrator has a zero at z = -1 there: its samples stand still while it swings. A
controller that costs little effort cancels zeros of this kind (Astrom, Hagander & Sternby, 1984),
and its samples look fine.
"""

from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour._arrays import largest
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference

DELAY = 1e-9  # magnitude of a pole, up to which its mode is a delay


class AxisLimits(NamedTuple):
    """Greatest magnitudes per axis or input; None where there is no limit."""

    speed: Float[Array | np.ndarray, " m"] | None = None  # (m,) [m/s]
    acceleration: Float[Array | np.ndarray, " m"] | None = None  # (m,) [m/s^2]
    control: Float[Array | np.ndarray, " p"] | None = None  # (p,) [control unit]
    increment: Float[Array | np.ndarray, " p"] | None = None  # (p,) [control unit per sample]
    # (m, p) acceleration between samples per unit of a control that alternates [m/s^2 per control
    # unit], as `hidden_acceleration` gives it; None to leave it out
    hidden: Float[Array | np.ndarray, "m p"] | None = None


class LimitUse(NamedTuple):
    """Largest |value| / limit over samples and axes; 1 is at the limit, 0 without a limit.

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
        reference: of the run; all its samples count, scored or not, those of padding do not.
        limits: those of the machine.
    """
    mask = reference.unpadded
    pairs = mask[1:] & mask[:-1]
    speed = jnp.diff(output, axis=0) / reference.dt
    triples = pairs[1:] & pairs[:-1]
    sampled = jnp.diff(speed, axis=0) / reference.dt
    acceleration = _largest(sampled, triples, limits.acceleration)
    if limits.acceleration is not None and limits.hidden is not None:
        parts = sampled, alternating(control) @ limits.hidden.T
        most = [largest(jnp.where(triples[:, None], jnp.abs(part), 0)) for part in parts]
        acceleration = largest(jnp.asarray(sum(most) / limits.acceleration))
    return LimitUse(
        _largest(speed, pairs, limits.speed),
        acceleration,
        _largest(control, mask, limits.control),
        _largest(jnp.diff(control, axis=0), pairs, limits.increment),
    )


def _largest(
    values: Float[Array, "T d"],
    counted: Bool[Array, " T"],
    limit: Float[Array | np.ndarray, " d"] | None,
) -> Float[Array, ""]:
    if limit is None:
        return jnp.zeros((), values.dtype)
    return largest(jnp.where(counted[:, None], jnp.abs(values) / limit[None], 0.0).ravel())


def hidden_acceleration(plant: LinearPlant, delay: int = 0) -> Float[np.ndarray, "m p"]:
    """Acceleration [m/s^2 per unit] that alternates beside what the samples show.

    Under u(k) = (-1)^k the state is x(k) = (-1)^k s with s = -(I + A)^-1 B. The mean acceleration
    of the tool within a sample is 2 |V s| / dt with its speed V x, V = C log(A) / dt. The second
    difference of its samples has 4 |C s| / dt^2. What is hidden is the first one less the second,
    and not below zero.

    A mass of 2 kg under a force, sampled every 0.1 s, hides all of its acceleration:

    >>> mass = LinearPlant([[1.0, 0.1], [0.0, 1.0]], [[0.0025], [0.05]], [[1.0, 0.0]], dt=0.1)
    >>> hidden_acceleration(mass).round(9).tolist()
    [[0.5]]

    Args:
        plant: concrete; modes that end within a few samples, those of delays, have no speed.
        delay: samples by which its control is late, which `with_input_delay` gave it.
    """
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    swing = np.linalg.lstsq(np.eye(plant.states) + A, -B, rcond=None)[0]
    speed = C @ _generator(A, plant.dt) @ np.linalg.matrix_power(A, delay)
    within = 2 * np.abs(speed @ swing) / plant.dt
    shown = 4 * np.abs(C @ swing) / plant.dt**2
    return np.maximum(within - shown, 0.0)


def alternating(
    control: Float[Array | np.ndarray, "*runs T p"],
) -> Float[Array | np.ndarray, "*runs T-2 p"]:
    """Part of a control that alternates: |u(k+1) - 2 u(k) + u(k-1)| / 4.

    >>> alternating(np.array([[1.0], [-1.0], [1.0], [3.0], [5.0]])).ravel().tolist()
    [1.0, 0.0, 0.0]
    """
    before, now, after = control[..., :-2, :], control[..., 1:-1, :], control[..., 2:, :]
    return abs(after - 2 * now + before) / 4


def _generator(A: Float[np.ndarray, "n n"], dt: float) -> np.ndarray:
    """Generator log(A) / dt of the motion; complex where a pole is negative."""
    from scipy.linalg import logm, schur, solve_sylvester  # takes a while to load

    # a lambda: SciPy counts the arguments of the function, and sees none of a decorated one
    slow_first = schur(A.astype(complex), output="complex", sort=lambda pole: abs(pole) > DELAY)
    upper, basis, slow = cast(tuple[np.ndarray, np.ndarray, int], slow_first)
    if not slow:
        return np.zeros_like(A)
    motion, mixed, delays = upper[:slow, :slow], upper[:slow, slow:], upper[slow:, slow:]
    coupling = solve_sylvester(motion, -delays, -mixed) if mixed.size else mixed
    # projection onto the coordinates of the motion
    back = np.hstack([np.eye(slow), -coupling]) @ basis.conj().T
    return basis[:, :slow] @ logm(motion) @ back / dt
