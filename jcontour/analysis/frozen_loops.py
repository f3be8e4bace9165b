"""Frozen loops: the closed loop linearised at one step of a run.

For small changes, the plan of that step held for ever, v the control that acts on the plant:

    x(k+1) = A x(k) + B v(k),        y(k) = H x(k)                        the plant
    w(k+1) = W w(k) + E y(k),        u(k) = K w(k) + D y(k)               the controller
x is the state of the plant, w the memory of the controller; v = u closes the loop. All floating
numbers of state, memory and measurement count; whole numbers (counters, taps) stay as they are.

Slopes, of the largest eigenvalue and of answers to disturbances, are worked out on the host: a
change of any matrix of a loop acts through a state and its weights. XLA has eigenvalues of general
matrices on a CPU alone, and there JAX (0.10) may wait for ever where two batches are computed at
the same time.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Complex, Float, Int

from jcontour._arrays import is_concrete
from jcontour.controller import Controller, Memory, Plan
from jcontour.plant import Plant, State


class CutLoops(NamedTuple):
    """Frozen loops cut at their control, for small changes; v = u closes them.

    z(k+1) = A z(k) + B v(k),   u(k) = C z(k)
    """

    A: Float[Array | np.ndarray, "*loops N N"]
    B: Float[Array | np.ndarray, "*loops N p"]
    C: Float[Array | np.ndarray, "*loops p N"]

    def closed(self, gains: ArrayLike = 1.0) -> Float[Array | np.ndarray, "*loops N N"]:
        """Closed loops A + B diag(gains) C: a change of control i acts `gains[i]` times as much."""
        return self.A + (self.B * gains) @ self.C

    def late(self, samples: int) -> Float[Array | np.ndarray, "*loops L L"]:
        """Closed loops with v(k) = u(k - samples), at least one sample.

        The state gains the line u(k-1), ..., u(k-samples).
        """
        A, B, C = self
        N, p = B.shape[-2:]
        kept, dtype = (samples - 1) * p, A.dtype
        return blocks(
            [
                [A, np.zeros((N, kept), dtype), B],
                [C, np.zeros((p, samples * p), dtype)],
                [np.eye(kept, N + samples * p, N, dtype)],
            ]
        )

    def acting(self) -> Bool[np.ndarray, "T p"]:
        """Controls that are part of a loop.

        Their row and their column in the Markov parameters C A^k B, k < N, are not all zero. Only
        the zeros of A, B and C are looked at: no power of an unstable A is taken.
        """
        A, B, C = (np.asarray(matrices) != 0 for matrices in self)
        reached = B
        for _ in range(1, A.shape[1]):
            reached = reached | A @ reached
        heard = C @ reached
        return heard.any(axis=1) & heard.any(axis=2)

    def at(self, rows: Int[np.ndarray, " R"]) -> "CutLoops":
        """Loops of some rows."""
        return CutLoops(*(matrices[rows] for matrices in self))


class LinearMachine(NamedTuple):
    """Plants of frozen loops."""

    A: Float[Array | np.ndarray, "*loops n n"]
    B: Float[Array | np.ndarray, "*loops n p"]
    H: Float[Array | np.ndarray, "*loops q n"]


class LinearLaw(NamedTuple):
    """Controllers of frozen loops."""

    W: Float[Array | np.ndarray, "*loops c c"]
    E: Float[Array | np.ndarray, "*loops c q"]
    K: Float[Array | np.ndarray, "*loops p c"]
    D: Float[Array | np.ndarray, "*loops p q"]


class FrozenLoop(NamedTuple):
    """Frozen loops in the letters of the module; batches of both that go together."""

    machine: LinearMachine
    law: LinearLaw

    def cut(self) -> CutLoops:
        """The loops cut at their control; the state is (x, w)."""
        (A, B, H), (W, E, K, D) = self
        n, c, p, dtype = A.shape[-1], W.shape[-1], B.shape[-1], A.dtype
        return CutLoops(
            blocks([[A, np.zeros((n, c), dtype)], [E @ H, W]]),
            blocks([[B], [np.zeros((c, p), dtype)]]),
            blocks([[D @ H, K]]),
        )

    def only(
        self, kept: Bool[np.ndarray, "*loops"] | np.bool_, others: "FrozenLoop | None" = None
    ) -> "FrozenLoop":
        """These loops where they are kept, else the others; zeros without others."""
        kept = np.asarray(kept)
        if kept.all():
            return self
        return jax.tree.map(
            lambda one, *other: np.where(kept[..., None, None], one, *(other or [0.0])),
            *(self,) if others is None else (self, others),
        )


def blocks(rows: Sequence[Sequence[Array | np.ndarray]]) -> Any:
    """Matrices of matrices; batches in front go together.

    >>> blocks([[np.ones((3, 1, 2)), np.zeros((1, 4))]]).shape
    (3, 1, 6)
    """
    every = [matrix for row in rows for matrix in row]
    library = np if is_concrete(*every) else jnp  # NumPy has nothing to compile
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in every))
    wide = [
        library.concatenate(
            [library.broadcast_to(M, (*batch, *M.shape[-2:])) for M in row], axis=-1
        )
        for row in rows
    ]
    return library.concatenate(wide, axis=-2)


def frozen_loop(
    plant: Plant, controller: Controller, plan: Plan, state: State, memory: Memory
) -> FrozenLoop:
    """The loop linearised at one step.

    Args:
        plant: smooth; a quantiser has no slope.
        controller: in whatever branch it is there: at a limit, its control does not move.
        plan: one row, that of the step.
        state: of the plant, before the step.
        memory: of the controller, before the step.
    """
    law, control = linear_law(controller, plan, memory, plant.measure(state))
    return FrozenLoop(linear_machine(plant, state, control), law)


def linear_machine(plant: Plant, state: State, control: Float[Array, " p"]) -> LinearMachine:
    """A plant linearised at a state and a control."""
    moving, fixed = eqx.partition(state, eqx.is_inexact_array)

    def step(inputs):
        moving, control = inputs
        state = eqx.combine(moving, fixed)
        after = plant.step(state, control), plant.measure(state)
        return eqx.filter(after, eqx.is_inexact_array)

    slope = _slope(step, (moving, control))
    n = slope.shape[1] - control.size
    return LinearMachine(slope[:n, :n], slope[:n, n:], slope[n:, :n])


def linear_law(
    controller: Controller, plan: Plan, memory: Memory, measurement: Any
) -> tuple[LinearLaw, Float[Array, " p"]]:
    """A controller linearised at a memory and a measurement, and its control there.

    One that plans for limits is linearised without them: at a limit there is no loop.
    """
    controller = controller.without_planned_limits()
    moving, fixed = eqx.partition(memory, eqx.is_inexact_array)
    seen, unseen = eqx.partition(measurement, eqx.is_inexact_array)

    def step(inputs):
        moving, seen = inputs
        after = controller.step(eqx.combine(moving, fixed), plan, eqx.combine(seen, unseen))
        return eqx.filter(after, eqx.is_inexact_array)

    _, control = controller.step(memory, plan, measurement)
    slope = _slope(step, (moving, seen))
    c = slope.shape[0] - control.size
    return LinearLaw(slope[:c, :c], slope[:c, c:], slope[c:, :c], slope[c:, c:]), control


def _slope(function: Any, inputs: Any) -> Float[Array, "outputs inputs"]:
    """Jacobian between two pytrees, each as one row."""
    flat, unravel = ravel_pytree(inputs)
    return jax.jacfwd(lambda row: ravel_pytree(function(unravel(row)))[0])(flat)


def unlimited(module: Any) -> Any:
    """The same plant or controller without limits.

    A controller plans for none, and every field `limit` (or `..._limit`) is infinite.
    """
    if isinstance(module, Controller):
        module = module.without_planned_limits()

    def without(path, leaf):
        name = getattr(path[-1], "name", "") if path else ""
        return jnp.full_like(leaf, jnp.inf) if name.endswith("limit") else leaf

    return jax.tree_util.tree_map_with_path(without, module)


SHIFT = 1e-8  # relative to an eigenvalue: its matrix minus this shift can still be inverted


class Dominant(NamedTuple):
    """Eigenvalues of matrices, the largest modulus, and its derivative Re(left' dM right)."""

    values: Complex[np.ndarray, "*loops N"]
    radius: Float[np.ndarray, "*loops"]
    left: Complex[np.ndarray, "*loops N"]
    right: Complex[np.ndarray, "*loops N"]


def dominant(M: Float[np.ndarray, "*loops N N"]) -> Dominant:
    """Largest eigenvalue l of finite matrices, on the host.

        d|l| = Re(conj(l) / |l| w'dM v / w'v),     v, w' right and left eigenvector of l.
    They are found by inverse iteration. Where the largest eigenvalue is not simple the derivative
    is that of one of them.
    """
    N = M.shape[-1]
    values = np.linalg.eigvals(M).astype(complex)
    chosen = np.argmax(np.abs(values), axis=-1)[..., None]
    largest = np.take_along_axis(values, chosen, axis=-1)[..., 0]
    shift = largest * (1 + SHIFT) + SHIFT**2
    inverse = np.linalg.inv(M - shift[..., None, None] * np.eye(N))
    first = np.broadcast_to(np.sin(1.0 + np.arange(N)), M.shape[:-1])  # not normal to any mode
    right = left = first.astype(complex)
    for _ in range(2):
        right = _unit((inverse @ right[..., None])[..., 0])
        left = _unit((left[..., None, :] @ inverse)[..., 0, :])
    with np.errstate(all="ignore"):  # a nilpotent matrix has no slope
        turned = np.exp(-1j * np.angle(largest)) / np.sum(left * right, axis=-1)
        left = np.nan_to_num(turned[..., None] * left, nan=0.0, posinf=0.0, neginf=0.0)
    return Dominant(values, np.abs(largest), left, right)


def _unit(vector: Complex[np.ndarray, "*loops N"]) -> Any:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def times(matrix: Array | np.ndarray, vector: Array | np.ndarray) -> Any:
    """Matrices (..., a, b) times vectors (..., b)."""
    return (matrix @ vector[..., None])[..., 0]


def real_outer(a: Array | np.ndarray, b: Array | np.ndarray) -> Float[np.ndarray, "*loops a b"]:
    """Real part of a b' for vectors in batches that go together."""
    return np.real(a[..., :, None] * b[..., None, :])


class Ends(NamedTuple):
    """Where a disturbance comes into a loop, and what of its answer counts, by weights."""

    control: Complex[np.ndarray, "*loops p"]  # added to the control
    reading: Complex[np.ndarray, "*loops q"]  # added to what the controller reads
    of_control: Complex[np.ndarray, "*loops p"]  # weights of the control
    of_reading: Complex[np.ndarray, "*loops q"]  # weights of what the sensors show


NO_ENDS = Ends(*[np.zeros(())] * 4)


def slope_of(loop: FrozenLoop, left, right, ends: Ends = NO_ENDS) -> FrozenLoop:
    """Derivative of Re(left' M right), ends included, with respect to the matrices of the loop.

    x and w are the states that `right` stands for, y what the controller reads and u the control
    then. of_x, ... are the weights of their changes, as far as `left` stands for them.
    """
    (A, B, H), (_, E, K, D) = loop
    n = A.shape[-1]
    x, w, of_x, of_w = right[..., :n], right[..., n:], left[..., :n], left[..., n:]
    y = times(H, x) + ends.reading
    u = times(D, y) + times(K, w) + ends.control
    of_u = times(turned(B), of_x) + ends.of_control
    of_y = times(turned(D), of_u) + times(turned(E), of_w) + ends.of_reading
    return FrozenLoop(
        LinearMachine(real_outer(of_x, x), real_outer(of_x, u), real_outer(of_y, x)),
        LinearLaw(
            real_outer(of_w, w), real_outer(of_w, y), real_outer(of_u, w), real_outer(of_u, y)
        ),
    )


def turned(matrix: Any) -> np.ndarray:
    """The transpose of the last two axes."""
    return np.swapaxes(matrix, -1, -2)
