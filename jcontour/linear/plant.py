"""Linear time-invariant plants, and the transformations that keep them linear.

x(k+1) = A x(k) + B u(k),  y(k) = C x(k)      (McNab & Tsao, eq. 9, with x(k+1) where they print a
derivative)
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.plant import Plant
from jcontour.tracing import is_concrete

ROUNDING = 1e-8  # of a double eigenvalue at 1, about the root of the machine's precision


class Pattern(NamedTuple):
    """Where A, B and C may be non-zero: hashable, so that it can steer compilation."""

    A: tuple[tuple[bool, ...], ...]
    B: tuple[tuple[bool, ...], ...]
    C: tuple[tuple[bool, ...], ...]

    @classmethod
    def of(cls, A, B, C) -> "Pattern":
        """Pattern of concrete matrices; where values are traced every entry counts as non-zero."""
        return cls(*(_nonzero(matrix) for matrix in (A, B, C)))


class AffinePlan(eqx.Module):
    """Control law u = f - F x for every step of a run."""

    F: Float[Array, "T p n"]
    f: Float[Array, "T p"]


class SteadyMotion(eqx.Module):
    """Maps from a steady motion of the tool to the state: x = Sy y + Sv dy, `dy` the increment per sample."""

    Sy: Float[Array, "n m"]
    Sv: Float[Array, "n m"]

    def state(
        self, position: Float[Array, "*batch m"], increment: Float[Array, "*batch m"]
    ) -> Float[Array, "*batch n"]:
        """State of a tool at `position` [m] that moves `increment` [m] per sample."""
        return position @ self.Sy.T + increment @ self.Sv.T


class LinearPlant(Plant):
    """A linear machine, and the model inside a model-based controller.

    Args:
        A: state matrix (n, n).
        B: input matrix (n, p).
        C: output matrix (m, n); outputs are positions [m].
        dt: sample period [s].
        pattern: non-zero pattern; derived from the matrices when they are concrete.
        motion: its maps of steady motion, where its axes are coupled; see `steady_motion`.

    Raises:
        ValueError: a matrix has the wrong shape or is not finite, or `dt` is not positive.
    """

    A: Float[Array, "n n"]
    B: Float[Array, "n p"]
    C: Float[Array, "m n"]
    motion: SteadyMotion | None
    dt: float = eqx.field(static=True)
    pattern: Pattern = eqx.field(static=True)

    def __init__(
        self, A, B, C, dt: float, pattern: Pattern | None = None, motion: SteadyMotion | None = None
    ):
        self.A, self.B, self.C = (_floating(matrix) for matrix in (A, B, C))
        self.dt, self.motion = float(dt), motion
        _check_shapes(self.A, self.B, self.C, self.dt)
        self.pattern = Pattern.of(A, B, C) if pattern is None else pattern

    @property
    def states(self) -> int:
        """Number of states n."""
        return self.A.shape[-1]

    @property
    def inputs(self) -> int:
        """Number of inputs p."""
        return self.B.shape[-1]

    @property
    def axes(self) -> int:
        """Number of outputs m."""
        return self.C.shape[-2]

    def initial_state(self, position, increment) -> Float[Array, " n"]:
        """Steady motion through `position`; see `steady_motion` for the equation and the errors raised."""
        return steady_motion(self).state(position, increment)

    def step(self, state, control) -> Float[Array, " n"]:
        """A x + B u."""
        return self.A @ state + self.B @ control

    def output(self, state) -> Float[Array, " m"]:
        """C x [m]."""
        return self.C @ state


def spectral_radius(M) -> Float[np.ndarray, "*batch"]:
    """Largest absolute eigenvalue of each matrix (..., n, n); infinite where a matrix is not finite."""
    M = np.asarray(M)
    finite = np.asarray(np.isfinite(M).all(axis=(-1, -2)))
    values = np.abs(np.linalg.eigvals(np.where(finite[..., None, None], M, 0.0))).max(axis=-1)
    return np.where(finite, values, np.inf)


def check_stable(name: str, M) -> None:
    """Raise ValueError, with the eigenvalues, unless all are inside the unit circle; traced values pass unchecked."""
    if not is_concrete(M) or spectral_radius(M) < 1 - ROUNDING:
        return
    M = np.asarray(M)
    values = (
        np.array2string(np.linalg.eigvals(M), precision=6, max_line_width=10**6)
        if np.isfinite(M).all()
        else "not finite"
    )
    raise ValueError(
        f"{name} is not stable: needs all eigenvalues inside the unit circle, they are {values}"
    )


class Axis(NamedTuple):
    """State, input and output indices of one part of a plant that nothing couples to the rest."""

    states: tuple[int, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]


def decoupled_axes(pattern: Pattern) -> tuple[Axis, ...]:
    """The independent parts of a plant, in the order of their outputs, read from its non-zero pattern."""
    A, B, C = np.array(pattern.A), np.array(pattern.B), np.array(pattern.C)
    n, p, m = A.shape[0], B.shape[1], C.shape[0]
    linked = np.zeros((n + p + m, n + p + m), bool)
    linked[:n, :n], linked[:n, n : n + p], linked[n + p :, :n] = A, B, C
    linked = linked | linked.T | np.eye(n + p + m, dtype=bool)
    for _ in range(int(np.ceil(np.log2(n + p + m)))):
        linked = linked @ linked
    parts = {tuple(np.flatnonzero(row)) for row in linked}
    axes = [
        Axis(
            tuple(int(i) for i in part if i < n),
            tuple(int(i) - n for i in part if n <= i < n + p),
            tuple(int(i) - n - p for i in part if i >= n + p),
        )
        for part in parts
    ]
    return tuple(sorted(axes, key=lambda axis: axis.outputs or (m,)))


def steady_motion(plant: LinearPlant) -> SteadyMotion:
    """Maps Sy, Sv of a plant: the state of a tool in steady motion. Its own where it has them; of decoupled single-input axes otherwise.

    Each axis with n_i states solves, for x and the constant control u that carries it on,
        C A^j x + sum_{i<j} C A^i B u = y + j dy,   j = 0..n_i.
    McNab & Tsao, Appendix, with the third row at x_d(k + N_p) and the u column scaled (condition
    1e7 otherwise).

    Raises:
        ValueError: an axis does not have one input and one output, or cannot hold a steady motion;
            give the maps then.
    """
    if plant.motion is not None:
        return plant.motion
    axes = decoupled_axes(plant.pattern)
    for axis in axes:
        if len(axis.inputs) != 1 or len(axis.outputs) != 1:
            raise ValueError(
                f"steady motion needs axes with one input and one output each; states {list(axis.states)} have inputs "
                f"{list(axis.inputs)} and outputs {list(axis.outputs)}: give SteadyMotion(Sy, Sv) or the state itself"
            )
    motion, conditions = _steady_motion(plant)
    for axis, condition in zip(axes, conditions, strict=True):
        if is_concrete(condition) and not condition * np.finfo(plant.A.dtype).eps < 1:
            raise ValueError(
                f"output {axis.outputs[0]}: the axis cannot hold a steady motion (its equations are singular)"
            )
    return motion


@eqx.filter_jit
def _steady_motion(plant: LinearPlant) -> tuple[SteadyMotion, list[Float[Array, ""]]]:
    Sy = Sv = jnp.zeros((plant.states, plant.axes), plant.A.dtype)
    conditions = []
    for axis in decoupled_axes(plant.pattern):
        rows, output = np.array(axis.states), axis.outputs[0]
        matrix = _steady_equations(
            plant.A[np.ix_(rows, rows)], plant.B[rows, axis.inputs[0]], plant.C[output, rows]
        )
        size = matrix.shape[0]
        ramp = jnp.stack(
            [jnp.ones(size, matrix.dtype), jnp.arange(size, dtype=matrix.dtype)], axis=1
        )
        maps = jnp.linalg.solve(matrix, ramp)[:-1]
        Sy, Sv = Sy.at[rows, output].set(maps[:, 0]), Sv.at[rows, output].set(maps[:, 1])
        conditions.append(jnp.linalg.cond(matrix))
    return SteadyMotion(Sy, Sv), conditions


def _steady_equations(A, B, C) -> Float[Array, "n+1 n+1"]:
    """Rows [C A^j, sum_{i<j} C A^i B], the last column scaled to one."""
    rows, column, response = [C], [jnp.zeros((), A.dtype)], B
    for _ in range(B.size):
        column.append(column[-1] + C @ response)
        response = A @ response
        rows.append(rows[-1] @ A)
    steady = jnp.stack(column)
    return jnp.concatenate([jnp.stack(rows), (steady / jnp.max(jnp.abs(steady)))[:, None]], axis=1)


def _floating(value) -> Array:
    array = jnp.asarray(value)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def _nonzero(matrix) -> tuple[tuple[bool, ...], ...]:
    where = (
        np.not_equal(np.asarray(matrix), 0) if is_concrete(matrix) else np.ones(matrix.shape, bool)
    )
    return tuple(tuple(bool(entry) for entry in row) for row in where)


def _check_shapes(A, B, C, dt: float) -> None:
    if A.ndim != 2 or A.shape[0] != A.shape[1] or A.shape[0] == 0:
        raise ValueError(f"A: needs to be square (n, n), received {A.shape}")
    n = A.shape[0]
    if B.ndim != 2 or B.shape[0] != n or B.shape[1] == 0:
        raise ValueError(f"B: needs shape ({n}, p) to go with A {A.shape}, received {B.shape}")
    if C.ndim != 2 or C.shape[1] != n or C.shape[0] == 0:
        raise ValueError(f"C: needs shape (m, {n}) to go with A {A.shape}, received {C.shape}")
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(
            f"dt: the sample period needs to be a positive number of seconds, received {dt}"
        )
    for name, matrix in (("A", A), ("B", B), ("C", C)):
        if is_concrete(matrix) and not np.isfinite(np.asarray(matrix)).all():
            raise ValueError(f"{name}: every entry needs to be finite, received NaN or inf")
