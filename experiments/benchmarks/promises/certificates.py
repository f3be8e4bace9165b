"""`jcontour bench certificates`: one certified bound with its slopes, and random laps against it.

The loop is the X-Y table of McNab & Tsao with the receding-horizon LQ of their kind behind a Kalman
filter, on three laps of a circle of 1 mm; the weights are alpha, beta and rho. In every lap forces
and encoder errors stay within their bounds. They are even, of two values, telegraph noise, waves,
or an attack with some of its signs turned.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from rich.console import Console

from experiments.benchmarks.speed.timings import seconds
from jcontour.app.flags.others import Bench
from jcontour.app.reports import tables
from jcontour.bounds.attacks import worst_attack
from jcontour.bounds.disturbed_family import DisturbedFamily
from jcontour.bounds.disturbed_loop import Box, disturbed_loop
from jcontour.bounds.peak_bounds import peak_bounds
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import FilterObserver, kalman_gain
from jcontour.devices import on_gpu
from jcontour.geometry.contours import circle
from jcontour.motion.references import Reference, along
from jcontour.plants.bridgeport import bridgeport
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import Encoders
from jcontour.simulation.closed_loop import follow
from jcontour.simulation.evaluation import stack_plants, stack_references

LAP, LAPS, PREVIEW = 252, 3, 10  # samples, as the reference numbers have it
FORCE, ENCODER = 0.02, 4e-7  # [control unit], [m] half a count
START = np.log([1.2, 20.0, 2e-9])  # ln alpha, ln beta, ln rho
STEP = 1e-4  # of the logarithms, for differences
BATCH = {False: 500, True: 25_000}  # laps at once: on a CPU, on a GPU
ATTACKED = (251, 200, 127, 60)  # samples that attacks are made for
TURNED = 1e-3  # largest part of an attack's signs that are turned, a power of ten less for others


@dataclass(frozen=True)
class CertificateResult:
    """Times of the bound, and what laps reached of it.

    Attributes:
        bound: certified contour error of the last lap [m].
        first: seconds of the first value and gradient, compiling included.
        again: seconds of the next ones, the median.
        slope_error: largest difference from central differences, over the largest slope.
        laps: that were run.
        largest: error over bound, largest of all laps and samples.
        above: laps with an error above the bound by more than 1e-9 of it.
        running: seconds of all laps, the making of the disturbances included.
    """

    bound: float
    first: float
    again: float
    slope_error: float
    laps: int
    largest: float
    above: int
    running: float


class _Circle:
    """The loop of the module as a function of the logarithms of its weights."""

    def __init__(self, laps: int):
        self.model, path = bridgeport(), circle(1e-3)
        self.plant = Encoders(self.model)
        arc = np.arange(LAP * laps) * float(path.length) / LAP
        self.reference = along(path, arc, self.model.dt, PREVIEW, at_rest=False)
        self.gain = kalman_gain(self.model, FORCE, ENCODER / np.sqrt(3))
        self.box = Box.of(FORCE, ENCODER, inputs=2, measured=2)

    def controller(self, logs: Float[Array | np.ndarray, "3"]) -> FilterObserver:
        alpha, beta, rho = jnp.exp(jnp.asarray(logs))
        inner = ContouringLQ(self.model, LQWeights(alpha, beta, rho), PREVIEW)
        return FilterObserver(inner, self.model, gain=self.gain)


def measured(flags: Bench, tell: Callable[[str], None]) -> CertificateResult:
    """Bound, slopes and times; then as many batches of laps as there are seeds.

    Raises:
        ValueError: more than one batch size.
    """
    if len(flags.batch) > 1:
        raise ValueError(f"batch: certificates takes one, received {len(flags.batch)}")
    batch = flags.batch[0] if flags.batch else BATCH[on_gpu()]
    bound, first, again, slope_error = _bound_and_slopes()
    tell(f"value and gradient: {first:.2f} s, then {again:.3f} s")
    found = []
    running = seconds(lambda: found.extend(random_laps(batch, flags.seeds, flags.first_seed, tell)))
    reached = np.concatenate(found)
    above = int(np.sum(reached > 1 + 1e-9))
    largest = float(reached.max())
    return CertificateResult(
        bound, first, again, slope_error, reached.size, largest, above, running
    )


def _bound_and_slopes() -> tuple[float, float, float, float]:
    """Bound, seconds of the first and of a later value with gradient, error of the gradient."""
    loop = _Circle(LAPS)
    references = stack_references([loop.reference])
    limit = np.full(2, np.inf)
    family = DisturbedFamily(stack_plants([loop.plant]), loop.box.force, loop.box.noise, limit)
    matrices = eqx.filter_jit(lambda logs: family.loops(loop.controller(logs), references))

    def worst(logs):
        last = LAP * (LAPS - 1), LAP * LAPS
        return family.worst(jax.device_get(matrices(logs)), references, last)

    @eqx.filter_jit
    def slopes(logs, attack):
        def error(logs):
            found = family.attacked(loop.controller(logs), references, attack)
            return jnp.asarray(found.error)[0, 0]

        return jax.grad(error)(logs)

    def both(logs):
        values, attack = worst(logs)
        return float(np.asarray(values.error)[0, 0]), np.asarray(slopes(logs, attack))

    first = seconds(lambda: both(START))
    again = float(np.median([seconds(lambda k=k: both(START + 1e-3 * k)) for k in range(1, 6)]))
    value, slope = both(START)
    differences = [
        (both(START + STEP * side)[0] - both(START - STEP * side)[0]) / (2 * STEP)
        for side in np.eye(3)
    ]
    error = np.abs(slope - differences).max() / np.abs(slope).max()
    return value, first, again, float(error)


def random_laps(
    batch: int, batches: int, first_seed: int, tell: Callable[[str], None]
) -> list[np.ndarray]:
    """Largest error over bound of every lap, from rest in the filter and a start in motion.

    The error is that along the normal of the circle, whose bound is exact.
    """
    loop = _Circle(1)
    controller, reference = loop.controller(START), loop.reference
    matrices = disturbed_loop(loop.plant, controller, reference)
    normals = _normals(reference)
    rows = np.einsum("tm,tmn->tn", normals, matrices.C)
    nominal = np.asarray(_errors(normals, reference, matrices.output))
    total = np.abs(nominal) + peak_bounds(matrices, rows[:, None], loop.box.size).bound[:, 0]
    attacks = [worst_attack(matrices, rows[k], k, loop.box, float(nominal[k])) for k in ATTACKED]
    adverse = np.stack([np.concatenate(attack, axis=1) for attack in attacks]) / loop.box.size
    size = jnp.asarray(loop.box.size)[None]
    plan = controller.prepare(reference)

    @partial(jax.jit, static_argnums=1)
    def reached(key, count):
        signs = disturbances(key, count, jnp.asarray(adverse))

        def lap(signs):
            w = signs * size
            pushed = Disturbed(loop.plant, force=w[:, :2], noise=w[:, 2:])
            run = follow(pushed, controller, plan, reference)
            error = jnp.abs(_errors(normals, reference, run.output))
            return jnp.max(error[1:] / jnp.asarray(total)[1:])

        return jax.vmap(lap)(signs)

    found = []
    for seed in range(first_seed, first_seed + batches):
        found.append(np.asarray(reached(jax.random.key(seed), batch)))
        tell(f"{len(found)} x {batch} laps: {max(one.max() for one in found):.12f} of the bound")
    return found


def _normals(reference: Reference) -> np.ndarray:
    tangent = np.asarray(reference.tangent)[: reference.steps]
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def _errors(normals, reference: Reference, output) -> Array:
    away = output - reference.position[: reference.steps]
    return jnp.sum(normals * away, axis=1)


def disturbances(key: Array, count: int, adverse: Float[Array, "a T d"]) -> Float[Array, "c T d"]:
    """Disturbances in units of their bounds, of five kinds in turn.

    Args:
        key: of the random numbers.
        count: of laps.
        adverse: signs of attacks.
    """
    steps, channels = adverse.shape[1:]
    keys = jax.random.split(key, 4)
    even = jax.random.uniform(keys[0], (count, steps, channels), minval=-1.0, maxval=1.0)
    often = jax.random.uniform(keys[1], (count, 1, 1), minval=0.01, maxval=0.5)
    flips = jax.random.bernoulli(keys[2], jnp.broadcast_to(often, even.shape))
    telegraph = jnp.where(jnp.cumsum(flips, axis=1) % 2 == 0, 1.0, -1.0)
    waves = jnp.sign(jnp.sin(0.3 * jnp.cumsum(jnp.abs(even), axis=1)))
    lap = np.arange(count)
    share = np.broadcast_to(TURNED / 10.0 ** (lap % 3)[:, None, None], even.shape)
    turned = jax.random.bernoulli(keys[3], share)
    attacks = adverse[lap // 5 % len(adverse)]
    attacks = jnp.where(turned, -attacks, attacks)
    kinds = jnp.stack([even, jnp.sign(even), telegraph, waves, attacks])
    return kinds[lap % 5, lap]


def show(console: Console, result: CertificateResult) -> None:
    """Both in words."""
    tables.say(
        console,
        f"Certified contour error of the circle {1e6 * result.bound:.6f} um: value and gradient "
        f"{result.first:.2f} s with compiling, then {1e3 * result.again:.0f} ms; "
        f"gradient against differences {result.slope_error:.1e}",
        f"{result.laps} random laps in {result.running:.1f} s: largest {result.largest:.12f} of "
        f"the bound, {result.above} above it by more than 1e-9",
    )
