"""Inverse filters with numbers that are tuned: smoothing of the model and weight, traceable.

    M_0 = [q / lambda + (1 - 2 q) + q lambda]^m,    T = (1 - rho lambda)^N

q = 1/4 and rho = 1 are those of Alter & Tsao. E' keeps the taps that the l1 optimum uses at the
first numbers; their values and the quotient W / (lambda^d B^u) follow from

    lambda^d B^u X + T E' = R

a square system. So E' stays exact while the numbers move, and optimal while its taps stay the same.
Numbers at which other taps were better, or at which these cannot meet the conditions, are said when
a filter is made of them: see `OptimalInverse.check`.

Zeros that would ring, B^r, are not cancelled: as in zero phase tracking the model followed is
M_0 B^r(lambda) B^r(1/lambda) / B^r(1)^2, which has no phase.
"""

import warnings
from dataclasses import dataclass
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour._arrays import is_concrete
from jcontour.controllers.feedforward.l1 import l1_optimum
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.model_matching import ModelMatching, Polynomial
from jcontour.controllers.feedforward.zpetc import RINGING, PreviewFilter, zero_phase_filter
from jcontour.linear.transfer_functions import (
    ON_CIRCLE,
    Roots,
    SortedZeros,
    TransferFunction,
    polynomial_from_zeros,
    sorted_zeros,
)

RANK_TOLERANCE = 1e-9  # least singular value of the conditions that a set of taps may have
CONDITIONED = 1e12  # greatest condition number of the square system: four digits are left
DEARER = 1e-6  # relative cost above the optimum at which other taps are reported


@dataclass(frozen=True, eq=False)
class OptimalInverse:
    """Optimal inverse of one axis, open in q and rho.

    The number and the places of the taps of E' are chosen once, at the numbers given here, and stay
    while q and rho are tuned.

    Args:
        plant: its transfer function.
        following: m, N_p and N.
        smoothing: q at which the taps of E' are chosen.
        weight: rho there.
        ringing: as in `sorted_zeros`; 1 cancels every stable zero.

    Raises:
        ValueError: the plant has a zero on the unit circle that is not one of those that ring, or
            the preview is shorter than its delay, or than what model and ringing zeros look ahead.
    """

    plant: TransferFunction
    following: ModelFollowing
    smoothing: float = 0.25
    weight: float = 1.0
    ringing: float = 1.0

    def __post_init__(self):
        held = self.zeros.on_circle
        if held.size:
            raise ValueError(
                f"plant: the zero {held[0]:.6g} is on the unit circle, no filter is optimal"
            )
        if self.following.preview < self.plant.delay:
            raise ValueError(
                f"preview: needs at least the plant's delay of {self.plant.delay} samples, "
                f"received {self.following.preview}"
            )
        needed = self.following.order + self.ringing_polynomial.size - 1
        if self.following.preview < needed:
            raise ValueError(
                f"preview: the model and the zeros that ring look {needed} samples ahead, "
                f"received {self.following.preview}"
            )

    @cached_property
    def zeros(self) -> SortedZeros:
        """Zeros of the plant: to cancel, on the unit circle, unstable; those that ring are none."""
        groups = sorted_zeros(self.plant, self.ringing)
        rings = self._rings(groups.on_circle), self._rings(groups.unstable)
        return SortedZeros(
            groups.cancellable, groups.on_circle[~rings[0]], groups.unstable[~rings[1]]
        )

    @cached_property
    def ringing_polynomial(self) -> Polynomial:
        """B^r."""
        groups = sorted_zeros(self.plant, self.ringing)
        left = np.concatenate([groups.on_circle, groups.unstable])
        return polynomial_from_zeros(left[self._rings(left)])

    def _rings(self, zeros: Roots) -> Bool[np.ndarray, "_"]:
        """Whether zeros in lambda are stable, or on the unit circle, and ring."""
        if self.ringing == 1:
            return np.zeros(zeros.shape, bool)
        return (np.abs(zeros) >= 1 - ON_CIRCLE) & (np.real(zeros) < 0)

    @cached_property
    def taps(self) -> tuple[int, ...]:
        """Places of E' that are used: those of the l1 optimum, and others until all is met."""
        problem = self._problem(self.smoothing, self.weight)
        count = problem.zeros.size
        support = list(l1_optimum(problem).support)
        samples = problem.powers(max(support, default=0) + count + 1)
        rows = np.concatenate([np.real(samples), np.imag(samples)])
        for k in range(rows.shape[1]):
            if len(support) == count:
                break
            larger = [*support, k]
            if k not in support and np.linalg.svd(rows[:, larger])[1][-1] > RANK_TOLERANCE:
                support = larger
        return tuple(sorted(support))

    def _problem(self, smoothing: float, weight: float) -> ModelMatching:
        """Conditions on E' at these numbers."""
        with jax.ensure_compile_time_eval():  # of numbers that are known, also inside a trace
            response = np.asarray(self.response(smoothing))
            below = np.asarray(_weight(self.following.constraint, weight))
        zeros = np.concatenate([np.zeros(self.plant.delay), self.zeros.unstable])
        return ModelMatching(zeros, response, below)

    @cached_property
    def kept(self) -> Polynomial:
        """lambda^d B^u."""
        unstable = polynomial_from_zeros(self.zeros.unstable)
        return np.concatenate([np.zeros(self.plant.delay), unstable])

    def response(self, smoothing) -> Float[Array, " c"]:
        """R = lambda^N_p M_0 B^r(1/lambda) / B^r(1)^2."""
        rings, following = self.ringing_polynomial, self.following
        model = jnp.convolve(_model(following.order, smoothing), rings[::-1])
        late = following.preview - following.order - rings.size + 1
        return jnp.concatenate([np.zeros(late), model / np.sum(rings) ** 2])

    def check(self, smoothing: float, weight: float) -> None:
        """Warn where other taps were better at these numbers.

        Raises:
            ValueError: the taps cannot meet the conditions there.
        """
        with jax.ensure_compile_time_eval():
            matrix = np.asarray(self._system(smoothing, weight))
            if not np.linalg.cond(matrix) < CONDITIONED:
                raise ValueError(
                    f"weight: at {float(weight):.6g} the taps of the inverse cannot meet the "
                    "conditions of its unstable zeros; take another value"
                )
            cost = float(np.abs(np.asarray(self.solved(smoothing, weight)[1])).sum())
        least = l1_optimum(self._problem(smoothing, weight)).cost
        if cost > (1 + DEARER) * least + DEARER:
            warnings.warn(
                f"optimal feedforward: its taps {self.taps} were chosen at smoothing "
                f"{self.smoothing:.6g} and weight {self.weight:.6g}; at {float(smoothing):.6g} and "
                f"{float(weight):.6g} the error may be {cost:.4g} with them and {least:.4g} with "
                "others: begin there",
                stacklevel=2,
            )

    def solved(self, smoothing, weight) -> tuple[Float[Array, " x"], Float[Array, " e"]]:
        """X and the values of E' at its taps."""
        matrix = self._system(smoothing, weight)
        unknown = matrix.shape[1] - len(self.taps)
        wanted = _padded(self.response(smoothing), matrix.shape[0])
        solution = jnp.linalg.solve(matrix, wanted)
        return solution[:unknown], solution[unknown:]

    def _system(self, smoothing, weight) -> Float[Array, "s s"]:
        """Columns of lambda^d B^u X + T E'."""
        below, kept = _weight(self.following.constraint, weight), self.kept
        long = self.response(smoothing).size, below.size + max(self.taps, default=0), kept.size
        size = max(long)
        of_kept = [np.pad(kept, (k, size - k - kept.size)) for k in range(size - kept.size + 1)]
        places = [np.eye(size, below.size, -k) for k in self.taps]
        of_taps = np.reshape(places, (len(places), size, below.size)) @ below
        return jnp.concatenate([np.stack(of_kept, axis=1), of_taps.T], axis=1)

    def polynomials(self, smoothing, weight) -> tuple[Float[Array, " c"], Float[Array, " d"]]:
        """Numerator and denominator of F = W / P."""
        quotient, _ = self.solved(smoothing, weight)
        stable = polynomial_from_zeros(self.zeros.cancellable)
        numerator = jnp.convolve(quotient, jnp.asarray(self.plant.denominator))
        return numerator, jnp.asarray(self.plant.gain * stable)


def optimal_filter(inverses: list[OptimalInverse], smoothing, weight) -> PreviewFilter:
    """F of every axis, traceable in its numbers.

    Args:
        inverses: one for each axis, with the same preview.
        smoothing: q, one number.
        weight: rho, one number.

    Raises:
        ValueError: the taps of an inverse cannot meet its conditions at these numbers.
    """
    if is_concrete(smoothing, weight):
        for inverse in inverses:
            inverse.check(smoothing, weight)
    pairs = [inverse.polynomials(smoothing, weight) for inverse in inverses]
    return _of_axes(pairs, inverses[0].following.preview)


def zero_phase_inverse(
    plants: list[TransferFunction], smoothing, ringing: float = RINGING, order: int = 1
) -> PreviewFilter:
    """Zero phase inverse of every axis behind the model [q / lambda + (1 - 2 q) + q lambda]^m.

    Args:
        plants: transfer functions of the axes.
        smoothing: q, one number.
        ringing: as in `sorted_zeros`.
        order: m of the model.
    """
    return smoothed_inverse(
        [zero_phase_filter(plant, ringing) for plant in plants], smoothing, order
    )


def smoothed_inverse(filters: list[PreviewFilter], smoothing, order: int = 1) -> PreviewFilter:
    """Inverse filters of all axes behind the model of `zero_phase_inverse`."""
    longest = max(one.preview for one in filters)
    model = _model(order, smoothing)
    pairs = []
    for one in filters:
        late = np.zeros(longest - one.preview)  # the axes stay together
        numerator = jnp.concatenate([late, jnp.convolve(model, one.numerator)])
        pairs.append((numerator, one.denominator))
    return _of_axes(pairs, longest + order)


def _of_axes(pairs: list[tuple[Array, Array]], preview: int) -> PreviewFilter:
    rows = []
    for column in zip(*pairs, strict=True):
        size = max(one.size for one in column)
        rows.append(jnp.stack([_padded(one, size) for one in column]))
    return PreviewFilter(rows[0], rows[1], preview)


@partial(jax.jit, static_argnums=0)
def _model(order: int, smoothing) -> Float[Array, " c"]:
    """lambda^m M_0."""
    q = jnp.asarray(smoothing, float)
    product = jnp.ones(1)
    for _ in range(order):
        product = jnp.convolve(product, jnp.stack([q, 1 - 2 * q, q]))
    return product


@partial(jax.jit, static_argnums=0)
def _weight(power: int, weight) -> Float[Array, " c"]:
    """T = (1 - rho lambda)^N."""
    rho = jnp.asarray(weight, float)
    product = jnp.ones(1)
    for _ in range(power):
        product = jnp.convolve(product, jnp.stack([jnp.ones_like(rho), -rho]))
    return product


def _padded(coefficients: Array, size: int) -> Array:
    """The polynomial with `size` coefficients."""
    return jnp.pad(coefficients, (0, size - coefficients.size))
