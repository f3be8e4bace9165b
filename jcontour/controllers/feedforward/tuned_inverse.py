"""Inverse filters with numbers that are tuned: smoothing of the model and weight, traceable.

    M_0 = [q / lambda + (1 - 2 q) + q lambda]^m,    T = (1 - rho lambda)^N

q = 1/4 and rho = 1 are those of Alter & Tsao. E' keeps the taps that the l1 optimum uses at the
first numbers; their values and the quotient W / (lambda^d B^u) follow from

    lambda^d B^u X + T E' = R

a square system. So E' stays exact while the numbers move, and optimal while its taps stay the same.
"""

from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controllers.feedforward.l1 import l1_optimum
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.model_matching import ModelMatching, Polynomial
from jcontour.controllers.feedforward.preview_filter import PreviewFilter
from jcontour.controllers.feedforward.zpetc import RINGING, zero_phase_filter
from jcontour.linear.transfer_functions import (
    TransferFunction,
    polynomial_from_zeros,
    sorted_zeros,
)

RANK_TOLERANCE = 1e-9  # least singular value of the conditions that a set of taps may have


@dataclass(frozen=True, eq=False)
class OptimalInverse:
    """Optimal inverse of one axis, open in q and rho.

    Args:
        plant: its transfer function.
        following: m, N_p and N.
        smoothing: q at which the taps of E' are chosen.
        weight: rho there.

    Raises:
        ValueError: the plant has a zero on the unit circle, or the preview is shorter than its
            delay.
    """

    plant: TransferFunction
    following: ModelFollowing
    smoothing: float = 0.25
    weight: float = 1.0

    def __post_init__(self):
        zeros = sorted_zeros(self.plant)
        if zeros.on_circle.size:
            raise ValueError(
                f"plant: the zero {zeros.on_circle[0]:.6g} is on the unit circle, "
                "no filter is optimal"
            )
        if self.following.preview < self.plant.delay:
            raise ValueError(
                f"preview: needs at least the plant's delay of {self.plant.delay} samples, "
                f"received {self.following.preview}"
            )

    @cached_property
    def taps(self) -> tuple[int, ...]:
        """Places of E' that are used: those of the l1 optimum, and others until all is met."""
        with jax.ensure_compile_time_eval():  # chosen once, also inside a trace
            response = np.asarray(_response(self.following, self.smoothing))
            below = np.asarray(_weight(self.following, self.weight))
        unstable = sorted_zeros(self.plant).unstable
        zeros = np.concatenate([np.zeros(self.plant.delay), unstable])
        problem = ModelMatching(zeros, response, below)
        count = problem.zeros.size
        found = list(l1_optimum(problem).support)
        samples = problem.powers(max(found, default=0) + count + 1)
        rows = np.concatenate([np.real(samples), np.imag(samples)])
        for k in range(rows.shape[1]):
            if len(found) == count:
                break
            larger = [*found, k]
            if k not in found and np.linalg.svd(rows[:, larger])[1][-1] > RANK_TOLERANCE:
                found = larger
        return tuple(sorted(found))

    @cached_property
    def kept(self) -> Polynomial:
        """lambda^d B^u."""
        unstable = polynomial_from_zeros(sorted_zeros(self.plant).unstable)
        return np.concatenate([np.zeros(self.plant.delay), unstable])

    def solved(self, smoothing, weight) -> tuple[Float[Array, " x"], Float[Array, " e"]]:
        """X and the values of E' at its taps."""
        response = _response(self.following, smoothing)
        below = _weight(self.following, weight)
        size = max(response.size, below.size + max(self.taps, default=0), self.kept.size)
        unknown = size - self.kept.size + 1
        columns = [_shifted(jnp.asarray(self.kept), k, size) for k in range(unknown)]
        columns += [_shifted(below, k, size) for k in self.taps]
        found = jnp.linalg.solve(jnp.stack(columns, axis=1), _shifted(response, 0, size))
        return found[:unknown], found[unknown:]

    def polynomials(self, smoothing, weight) -> tuple[Float[Array, " c"], Float[Array, " d"]]:
        """Numerator and denominator of F = W / P."""
        quotient, _ = self.solved(smoothing, weight)
        stable = polynomial_from_zeros(sorted_zeros(self.plant).cancellable)
        numerator = jnp.convolve(quotient, jnp.asarray(self.plant.denominator))
        return numerator, jnp.asarray(self.plant.gain * stable)


def optimal_filter(inverses: list[OptimalInverse], smoothing, weight) -> PreviewFilter:
    """F of every axis, traceable in its numbers.

    Args:
        inverses: one for each axis, with the same preview.
        smoothing: q, one number.
        weight: rho, one number.
    """
    pairs = [inverse.polynomials(smoothing, weight) for inverse in inverses]
    return _of_axes(pairs, inverses[0].following.preview)


def zero_phase_inverse(
    plants: list[TransferFunction], smoothing, ringing: float = RINGING
) -> PreviewFilter:
    """Zero phase inverse of every axis behind the model q / lambda + (1 - 2 q) + q lambda.

    Args:
        plants: transfer functions of the axes.
        smoothing: q, one number.
        ringing: as in `sorted_zeros`.
    """
    filters = [zero_phase_filter(plant, ringing) for plant in plants]
    preview = max(one.preview for one in filters) + 1
    q = jnp.asarray(smoothing, float)
    model = jnp.stack([q, 1 - 2 * q, q])
    pairs = []
    for one in filters:
        late = jnp.zeros(preview - 1 - one.preview)  # the axes stay together
        numerator = jnp.concatenate([late, jnp.convolve(model, one.numerator)])
        pairs.append((numerator, one.denominator))
    return _of_axes(pairs, preview)


def _of_axes(pairs: list[tuple[Array, Array]], preview: int) -> PreviewFilter:
    rows = []
    for column in zip(*pairs, strict=True):
        size = max(one.size for one in column)
        rows.append(jnp.stack([_shifted(one, 0, size) for one in column]))
    return PreviewFilter(rows[0], rows[1], preview)


def _response(following: ModelFollowing, smoothing) -> Float[Array, " c"]:
    """R = lambda^N_p M_0."""
    q = jnp.asarray(smoothing, float)
    found = jnp.zeros(following.preview - following.order + 1).at[-1].set(1.0)
    for _ in range(following.order):
        found = jnp.convolve(found, jnp.stack([q, 1 - 2 * q, q]))
    return found


def _weight(following: ModelFollowing, weight) -> Float[Array, " c"]:
    """T = (1 - rho lambda)^N."""
    rho = jnp.asarray(weight, float)
    found = jnp.ones(1)
    for _ in range(following.constraint):
        found = jnp.convolve(found, jnp.stack([jnp.ones_like(rho), -rho]))
    return found


def _shifted(coefficients: Array, places: int, size: int) -> Array:
    """Polynomial times lambda^places, with `size` coefficients."""
    return jnp.pad(coefficients, (places, size - places - coefficients.size))
