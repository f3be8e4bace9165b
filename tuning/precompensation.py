"""A reference that is bent beforehand, so that the tool of a whole family runs on the contour.

The reference p(k) is shifted by c(k), zero at both ends and where it is held. With
e_i(c) = p - y_i(p + c), the error of plant i,

    minimise over c the largest over i of  J_i(c) + size |c|^2 + roughness |c''|^2, all means
    J_i = mean of e_i' W e_i,   W = (1 - contouring) I + contouring (I - t t')
over the samples that count; where the reference rests nothing is along it, and W = I. c'' is the
second difference, with no shift before and after. It may be bounded, so that the bent reference
asks for no more acceleration than the machine has.
Of a linear loop e_i is affine in c. For weights lambda_i >= 0 of sum one, the minimum of
sum_i lambda_i J_i solves

    (sum_i lambda_i G_i' W G_i + R) d = sum_i lambda_i G_i' W e_i - R c,   R = size + roughness D' D
by conjugate gradients, G_i a run's derivative and G_i' the same backwards. Multiplicative weights
(Arora, Hazan & Kale 2012) raise lambda of the plants that are worse off: with the right lambda the
weighted minimum is that of the largest. Any other loop is linearised anew in every round, and
every round takes one step towards the bounds, by the alternating direction method of multipliers
(Boyd, Parikh, Chu, Peleato & Eckstein 2011, sections 3.1 to 3.4). c'' has a copy z within the
bounds, with the scaled multiplier u:

    c <- argmin of f(c) + penalty mean |c'' - z + u|^2
    h <- RELAXED c'' + (1 - RELAXED) z,    z <- clip(h + u),    u <- u + h - z
They balance two residuals by the penalty. Here the cost is flat and the bounds count: the penalty
grows for as long as c'' is outside.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, Bool, Float

from jcontour._devices import on_cpu
from jcontour.controller import Controller
from jcontour.controllers.learning.laps import Learned
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import family_batching

TOLERANCE, ITERATIONS = 1e-8, 30  # of the conjugate gradients: the next round goes on from there
ROUNDS = 8  # of weights: more change the largest error by a few per cent
MORE = 4  # times as many, at most, until the bounds are kept
RATE = 2.0  # of the weights: exp(2) from a plant without error to the worst, then ever less
RELAXED = 1.6
INSIDE = 0.97  # of the bounds, that z keeps: c'' comes near it, from both sides
FIRST = 10.0  # penalty beside errors of weight one
OUTSIDE = 0.01  # of the way between the bounds, beyond which the penalty grows
GROWTH = 1.4  # in a step: 2 is within sooner, and 1.3 times as far from the least error


class Prices(NamedTuple):
    """Weights of the errors and of a correction.

    Attributes:
        contouring: part of the weight that is on the contour error alone.
        size: of the correction, relative to an error of the same size.
        roughness: of its second difference, likewise.
    """

    contouring: float = 0.9
    size: float = 1e-6
    roughness: float = 1e-2


class Precompensated(NamedTuple):
    """A correction of a reference.

    Attributes:
        correction: c (T, m), added to the reference [m].
        before: RMS weighted error of every plant without it (P,) [m].
        after: with it (P,) [m].
        weight: lambda of every plant at the end (P,).
    """

    correction: Float[np.ndarray, "T m"]
    before: Float[np.ndarray, " P"]
    after: Float[np.ndarray, " P"]
    weight: Float[np.ndarray, " P"]


class Bounds(NamedTuple):
    """Bounds |c'' - middle| <= reach of a correction's second difference [m] at every sample.

    A bent reference p + c with |p'' + c''| <= a dt^2 has the middle -p'' and the reach a dt^2.
    """

    middle: Float[np.ndarray, "T m"]
    reach: Float[np.ndarray, "T m"]  # infinite where there is none

    @classmethod
    def none(cls, steps: int, axes: int) -> "Bounds":
        """Of a correction that may bend as it likes."""
        return cls(np.zeros((steps, axes)), np.full((steps, axes), np.inf))

    @property
    def are_some(self) -> bool:
        """Whether anything is bounded."""
        return bool(np.isfinite(self.reach).any())

    @property
    def inner(self) -> tuple[Float[np.ndarray, "T m"], Float[np.ndarray, "T m"]]:
        """Least and greatest, a few per cent inside, but never without the straight correction."""
        reach = INSIDE * self.reach
        return np.minimum(self.middle - reach, 0.0), np.maximum(self.middle + reach, 0.0)

    def keep(self, correction: Float[np.ndarray, "T m"]) -> bool:
        """Whether a correction is within."""
        bend = np.asarray(bend_of(jnp.asarray(correction)))
        return bool(np.all(np.abs(bend - self.middle) <= self.reach))


class Copy(NamedTuple):
    """The copy of a bend."""

    place: Float[Array, "T m"]  # z [m]
    multiplier: Float[Array, "T m"]  # u [m]
    penalty: Float[Array, ""]  # of their distance

    @classmethod
    def of(cls, bounds: Bounds) -> "Copy":
        """Of a straight correction; without bounds there is no penalty."""
        still = jnp.zeros(bounds.reach.shape)
        return cls(still, still, jnp.asarray(FIRST if bounds.are_some else 0.0))

    def after(self, bend: Float[Array, "T m"], within: tuple[Array, Array]) -> "Copy":
        """The copy, the multiplier and the penalty after a correction with this bend.

        Args:
            bend: c'' [m].
            within: least and greatest value of the copy [m].
        """
        passed = RELAXED * bend + (1 - RELAXED) * self.place
        place = jnp.clip(passed + self.multiplier, *within)
        multiplier = self.multiplier + passed - place
        least, most = within
        beyond = jnp.maximum(least - bend, bend - most)
        factor = jnp.where(jnp.any(beyond > OUTSIDE * (most - least)), GROWTH, 1.0)
        return Copy(place, multiplier / factor, factor * self.penalty)


def bend_of(correction: Float[Array, "T m"]) -> Float[Array, "T m"]:
    """Second difference c(k+1) - 2 c(k) + c(k-1); there is no shift before and after.

    >>> bend_of(jnp.array([[0.0], [1.0], [0.0]])).ravel().tolist()
    [1.0, -2.0, 1.0]
    """
    whole = jnp.pad(correction, ((1, 1), (0, 0)))
    return whole[2:] - 2 * whole[1:-1] + whole[:-2]


bend_back = bend_of  # its transpose: the matrix is symmetric


def eased(residual: Float[Array, "T m"], size: Array, rough: Array) -> Float[Array, "T m"]:
    """(sqrt(size) - sqrt(rough) D)^-2 of a residual, D the second difference."""
    steps = residual.shape[0]
    beside = jnp.full(steps, -jnp.sqrt(rough))
    middle = jnp.full(steps, jnp.sqrt(size) + 2 * jnp.sqrt(rough))
    lower, upper = beside.at[0].set(0.0), beside.at[-1].set(0.0)
    once = jax.lax.linalg.tridiagonal_solve(lower, middle, upper, residual)
    return jax.lax.linalg.tridiagonal_solve(lower, middle, upper, once)


@on_cpu()  # both modes of the loops are taken
def precompensate(
    plants: Plant,
    controller: Controller,
    reference: Reference,
    prices: Prices,
    rounds: int = ROUNDS,
    held: Bool[np.ndarray, " T"] | None = None,
    bounds: Bounds | None = None,
    tell: Callable[[int], None] | None = None,
) -> Precompensated:
    """Correction that makes the largest error of a family small.

    Args:
        plants: the family, stacked; with derivatives.
        controller: any that is traceable; it follows the shifted reference.
        reference: where the tool should be.
        prices: of errors and of the correction.
        rounds: of weights; one minimises the mean over the family. Where bounds are not kept by
            then, there are more, up to `MORE` times as many.
        held: samples where the reference stays as it is, as where a program stops; None for none.
        bounds: of the correction's second difference; None for none.
        tell: hears the number of every round that is done, from one; None for nobody.

    Raises:
        ValueError: a price is negative or not finite, the part is not from zero to one, there is no
            round, or as `simulate`.
    """
    contouring, size, roughness = prices
    for name, price in (("size", size), ("roughness", roughness)):
        if not (np.isfinite(price) and price >= 0):
            raise ValueError(f"{name}: needs to be finite and not negative, received {price}")
    if not 0 <= contouring <= 1:
        raise ValueError(f"contouring: needs to be from zero to one, received {contouring}")
    if rounds < 1:
        raise ValueError(f"rounds: needs at least one, received {rounds}")
    free = _free(reference.steps, held)
    errors = _weighted_errors(plants, controller, reference, contouring, free)
    still = jnp.zeros((reference.steps, reference.position.shape[-1]))
    penalties = jnp.asarray([size, roughness])
    bounds = bounds or Bounds.none(*still.shape)
    within = jax.tree.map(jnp.asarray, bounds.inner)
    before = np.asarray(_sizes(errors(still)))
    weight = np.full(before.shape, 1 / before.size)
    best = Precompensated(np.asarray(still), before, before, weight)
    least, correction, copy = float(np.max(before) ** 2), still, Copy.of(bounds)
    for number in range(1, MORE * rounds + 1):
        correction, copy = _improved(
            errors, correction, jnp.asarray(weight), penalties, free, copy, within
        )
        after = np.asarray(_sizes(errors(correction)))
        cost = float(np.max(after) ** 2 + _price(correction, penalties, free))
        shown = np.asarray(free * correction)
        kept = bounds.keep(shown)
        if cost < least and kept:
            best, least = Precompensated(shown, before, after, weight), cost
        shares = after**2 / max(float(np.max(after**2)), np.finfo(float).tiny)
        weight = weight * np.exp(RATE / np.sqrt(number) * (shares - 1))
        weight = weight / weight.sum()
        if tell is not None:
            tell(number)
        if number >= rounds and kept:
            break
    return best


def _free(steps: int, held: Bool[np.ndarray, " T"] | None) -> Float[Array, "T one"]:
    """One where the reference may be shifted; it begins and ends as it is."""
    free = np.ones((steps, 1)) if held is None else np.where(held, 0.0, 1.0)[:, None]
    free[[0, -1]] = 0.0
    return jnp.asarray(free)


def _weighted_errors(
    plants: Plant,
    controller: Controller,
    reference: Reference,
    contouring: float,
    free: Float[Array, "T one"],
) -> Callable[[Array], Array]:
    """(T, m) -> W^(1/2) e of every plant, scaled so that its square sum is the mean square."""
    steps = reference.steps
    wanted, tangent = (
        jnp.asarray(rows)[:steps] for rows in (reference.position, reference.tangent)
    )
    tangent = jnp.where(_moves(wanted), tangent, 0.0)
    scored = jnp.asarray(reference.mask)[:steps, None]
    along = float(1 - np.sqrt(1 - contouring))  # W^(1/2) = I - along t t'
    scale = float(1 / np.sqrt(max(int(jnp.sum(scored)), 1)))

    @eqx.filter_jit
    def errors(correction: Array) -> Array:
        def on(plant: Plant) -> Array:
            run = simulate(plant, Learned(controller, free * correction), reference)
            error = wanted - run.output
            lag = jnp.sum(error * tangent, axis=-1, keepdims=True) * tangent
            return jnp.where(scored, scale * (error - along * lag), 0.0)

        return family_batching(plants)(on, plants)

    return errors


def _moves(wanted: Float[Array, "T m"]) -> Bool[Array, "T one"]:
    """Whether the reference moves: into a sample, or out of the first one."""
    steps = jnp.any(jnp.diff(wanted, axis=0) != 0.0, axis=1, keepdims=True)
    return jnp.concatenate([steps[:1], steps])


@jax.jit
def _sizes(errors: Float[Array, "P T m"]) -> Float[Array, " P"]:
    return jnp.sqrt(jnp.sum(errors**2, axis=(1, 2)))


@jax.jit
def _price(
    correction: Float[Array, "T m"], prices: Float[Array, " two"], free: Float[Array, "T one"]
) -> Float[Array, ""]:
    """size |c|^2 + roughness |c''|^2, as means over the samples."""
    shown = free * correction
    size, rough = prices / correction.shape[0]
    return size * jnp.sum(shown**2) + rough * jnp.sum(bend_of(shown) ** 2)


@eqx.filter_jit
def _improved(
    errors: Callable[[Array], Array],
    correction: Array,
    weight: Array,
    prices: Array,
    free: Array,
    copy: Copy,
    within: tuple[Array, Array],
) -> tuple[Float[Array, "T m"], Copy]:
    """Minimum of the weighted square sum beside a copy, of the loops linearised here."""
    here, slopes = jax.linearize(errors, correction)
    back = jax.linear_transpose(slopes, correction)
    each = weight[:, None, None]
    # prices count per sample, as the mean square does
    steps = correction.shape[0]
    size, rough = (prices + jnp.array([0.0, 1.0]) * copy.penalty) / steps

    def priced(change: Array) -> Array:
        return size * change + rough * free * bend_back(bend_of(free * change))

    def normal(change: Array) -> Array:
        (pulled,) = back(each * slopes(change))
        return pulled + priced(change)

    def preconditioned(residual: Array) -> Array:
        # a loop's slopes are about one where it follows
        inside = eased(free * residual, 1 / steps + size, rough)
        return free * inside + (1 - free) * residual

    (pulled,) = back(each * here)
    wanted = free * bend_back(copy.place - copy.multiplier) * copy.penalty / steps
    change, _ = cg(
        normal,
        wanted - pulled - priced(correction),
        tol=TOLERANCE,
        maxiter=ITERATIONS,
        M=preconditioned,
    )
    correction = correction + change
    return correction, copy.after(bend_of(free * correction), within)
