"""Linear time-invariant plants, their independent axes and their steady motions.

    x(k+1) = A x(k) + B u(k),  y(k) = C x(k)

McNab & Tsao, eq. 9, with x(k+1) where they print a derivative.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import floating, is_concrete
from jcontour.linear.small_matrices import small_solve
from jcontour.plant import Plant

ROUNDED = 3e-5  # drift of a standstill, over its state; 1.2e-5 as McNab and Tsao print their table
COUPLED = (
    "give LinearPlant(A, B, C, dt, motion=SteadyMotion(Sy, Sv)), "
    "from jcontour.linear.plant import SteadyMotion"
)
ROUNDING = 1e-8  # of a double eigenvalue at 1, about the root of the machine's precision
LARGEST_SUMMED = 16  # rows or columns of a small product: a library is faster beyond


class Pattern(NamedTuple):
    """Non-zero pattern of A, B and C: hashable, so that it can steer compilation."""

    A: tuple[tuple[bool, ...], ...]
    B: tuple[tuple[bool, ...], ...]
    C: tuple[tuple[bool, ...], ...]

    @classmethod
    def of(cls, A, B, C) -> "Pattern":
        """Pattern of concrete matrices; every entry of a traced one counts as non-zero."""
        return cls(*(_nonzero(matrix) for matrix in (A, B, C)))


class AffinePlan(eqx.Module):
    """Control law u = f - F x for every step of a run."""

    F: Float[Array, "T p n"]
    f: Float[Array, "T p"]

    def at(self, point: "OperatingPoint") -> "AffinePlan":
        """The law u = u_0 + f - F (x - x_0), which counts from a standstill."""
        return AffinePlan(self.F, self.f + (point.control[None] + self.F @ point.state))


class SteadyMotion(eqx.Module):
    """Maps from a steady motion of the tool to the state.

    x = Sy y + Sv dy, `dy` the increment per sample.
    """

    Sy: Float[Array, "n m"]
    Sv: Float[Array, "n m"]

    def state(
        self,
        position: Float[Array | np.ndarray, "*batch m"],
        increment: Float[Array | np.ndarray, "*batch m"],
    ) -> Float[Array, "*batch n"]:
        """State of a tool at `position` [m] that moves `increment` [m] per sample."""
        return _steady_state(self.Sy, self.Sv, position, increment)


@jax.jit  # one program where it is called outside of one
def _steady_state(Sy, Sv, position, increment):
    return position @ Sy.T + increment @ Sv.T


class OperatingPoint(NamedTuple):
    """A standstill that a linear law counts from."""

    position: Float[Array, " m"]  # of the tool [m]
    state: Float[Array, " n"]  # of the model there
    control: Float[Array, " p"]  # that holds it there


class LinearPlant(Plant):
    """A linear machine, and the model inside a model-based controller.

    A slide with viscous friction, sampled every millisecond:

    >>> plant = LinearPlant([[1.0, 1e-3], [0.0, 0.99]], [[0.0], [1e-3]], [[1.0, 0.0]], dt=1e-3)
    >>> plant.states, plant.inputs, plant.axes
    (2, 1, 1)
    >>> plant.step(np.array([0.5, 0.0]), np.array([2.0])).tolist()
    [0.5, 0.002]

    Args:
        A: state matrix (n, n).
        B: input matrix (n, p).
        C: output matrix (m, n); outputs are positions [m].
        dt: sample period [s].
        pattern: non-zero pattern; derived from the matrices when they are concrete.
        motion: maps of steady motion, needed where the axes are coupled; see `steady_motion`.

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
        self,
        A,
        B,
        C,
        dt: float | int,
        pattern: Pattern | None = None,
        motion: SteadyMotion | None = None,
    ):
        self.A, self.B, self.C = floating(A, "A"), floating(B, "B"), floating(C, "C")
        self.dt, self.motion = float(dt), motion
        given, (A, B, C) = (A, B, C), (self.A, self.B, self.C)
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
        self.pattern = Pattern.of(*given) if pattern is None else pattern

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
        """State of a steady motion through `position`; equation and errors as `steady_motion`."""
        return steady_motion(self).state(jnp.asarray(position), jnp.asarray(increment))

    def holding_control(self, position) -> Float[Array, " p"]:
        """Control u of a standstill x: B u = x - A x, in the sense of least squares.

        It is zero where a standstill hardly drifts (`ROUNDED`, in a sample): printed matrices of
        drives that take a speed are rounded.

        Raises:
            ValueError: as `steady_motion`.
        """
        position = jnp.asarray(position)
        rest = steady_motion(self).state(position, jnp.zeros_like(position))
        return _holding(self.A, self.B, rest)

    def step(self, state, control) -> Float[Array, " n"]:
        """A x + B u."""
        return small_product(self.A, state) + small_product(self.B, control)

    def output(self, state) -> Float[Array, " m"]:
        """C x [m]."""
        return small_product(self.C, state)


def spectral_radius(M) -> Float[np.ndarray, "*batch"]:
    """Largest absolute eigenvalue of each matrix (..., n, n).

    >>> float(spectral_radius([[0.5, 1.0], [0.0, -0.9]]))
    0.9

    It is infinite where a matrix is not finite.
    """
    M = np.asarray(M)
    finite = np.asarray(np.isfinite(M).all(axis=(-1, -2)))
    values = np.abs(np.linalg.eigvals(np.where(finite[..., None, None], M, 0.0))).max(axis=-1)
    return np.where(finite, values, np.inf)


def check_stable(name: str, M) -> None:
    """Raise ValueError, with the eigenvalues, unless all are inside the unit circle.

    Traced values pass unchecked.
    """
    if not is_concrete(M) or spectral_radius(M) < 1 - ROUNDING:
        return
    M = np.asarray(M)
    values = "not finite"
    if np.isfinite(M).all():
        eigenvalues = np.real_if_close(np.linalg.eigvals(M))  # NumPy 2.5 has no others
        values = np.array2string(eigenvalues, precision=6, max_line_width=10**6)
    raise ValueError(
        f"{name} is not stable: needs all eigenvalues inside the unit circle, they are {values}"
    )


class Axis(NamedTuple):
    """State, input and output indices of one part of a plant that nothing couples to the rest."""

    states: tuple[int, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]


def decoupled_axes(pattern: Pattern) -> tuple[Axis, ...]:
    """Independent parts of a plant in the order of their outputs, read from its pattern."""
    A, B, C = np.array(pattern.A), np.array(pattern.B), np.array(pattern.C)
    n, p, m = A.shape[0], B.shape[1], C.shape[0]
    linked = np.zeros((n + p + m, n + p + m), bool)
    linked[:n, :n], linked[:n, n : n + p], linked[n + p :, :n] = A, B, C
    linked = linked | linked.T | np.eye(n + p + m, dtype=bool)
    for _ in range(int(np.ceil(np.log2(n + p + m)))):
        linked = linked @ linked
    axes = []
    for part in {tuple(np.flatnonzero(row).tolist()) for row in linked}:
        states = tuple(i for i in part if i < n)
        inputs = tuple(i - n for i in part if n <= i < n + p)
        outputs = tuple(i - n - p for i in part if i >= n + p)
        axes.append(Axis(states, inputs, outputs))
    return tuple(sorted(axes, key=lambda axis: axis.outputs or (m,)))


def steady_motion(plant: LinearPlant) -> SteadyMotion:
    """Maps Sy, Sv from a steady motion of the tool to the state of a plant.

    A plant that was given its maps returns them. Otherwise its axes need to be decoupled, each
    with one input and one output. An axis with n_i states solves, for x and the constant control u
    that carries it on,

        C A^j x + sum_{i<j} C A^i B u = y + j dy,   j = 0..n_i.
    McNab & Tsao, Appendix, with the third row at x_d(k + N_p). A standstill solves A x + B u = x,
    C x = y: powers of A lose digits. We scale every column, as states have units of their own:
    those of a delay line count the control in steps of the position.

    Raises:
        ValueError: an axis does not have one input and one output, or cannot hold a steady motion;
            give the maps then.
    """
    if plant.motion is not None:
        return plant.motion
    coupled = _coupled_axis(plant.pattern)
    if coupled is not None:
        raise ValueError(
            "steady motion needs axes with one input and one output each, inputs "
            f"{list(coupled.inputs)} and outputs {list(coupled.outputs)} hang together; {COUPLED}"
        )
    motion, conditions = _steady_motion(plant)
    for axis, condition in zip(decoupled_axes(plant.pattern), conditions, strict=True):
        if is_concrete(condition) and not float(condition) * np.finfo(plant.A.dtype).eps < 1:
            raise ValueError(
                f"output {axis.outputs[0]}: the axis cannot hold a steady motion "
                "(its equations are singular)"
            )
    return motion


def _coupled_axis(pattern: Pattern) -> Axis | None:
    """First part that has not one input and one output; None where every part has."""
    for axis in decoupled_axes(pattern):
        if len(axis.inputs) != 1 or len(axis.outputs) != 1:
            return axis
    return None


@eqx.filter_jit
def _steady_motion(plant: LinearPlant) -> tuple[SteadyMotion, list[Float[Array, ""]]]:
    Sy = Sv = jnp.zeros((plant.states, plant.axes), plant.A.dtype)
    conditions = []
    for axis in decoupled_axes(plant.pattern):
        rows, output = np.array(axis.states), axis.outputs[0]
        A, B, C = plant.A[np.ix_(rows, rows)], plant.B[rows, axis.inputs[0]], plant.C[output, rows]
        # rows [C A^j, sum_{i<j} C A^i B], the last column scaled to one
        equations, column, response = [C], [jnp.zeros((), A.dtype)], B
        for _ in range(B.size):
            column.append(column[-1] + C @ response)
            response = A @ response
            equations.append(equations[-1] @ A)
        steady = jnp.stack(column)
        steady = (steady / jnp.max(jnp.abs(steady)))[:, None]
        matrix = jnp.concatenate([jnp.stack(equations), steady], axis=1)
        size = matrix.shape[0]
        sample = jnp.arange(size, dtype=matrix.dtype)
        # powers of two just above the sizes: columns that are divided by them keep their digits
        sizes = jnp.max(jnp.abs(matrix[:, :-1]), axis=0)
        _, exponents = jnp.frexp(jax.lax.stop_gradient(sizes))
        size_of_states = jnp.ldexp(jnp.ones_like(sizes), exponents)
        matrix = matrix.at[:, :-1].divide(size_of_states)
        moving = small_solve(matrix, sample)[:-1] / size_of_states
        still = jnp.block([[A - jnp.eye(B.size), B[:, None]], [C[None], jnp.zeros((1, 1))]])
        still = still / jnp.append(size_of_states, jnp.max(jnp.abs(B)))[None]
        resting = small_solve(still, jnp.eye(size)[-1])[:-1] / size_of_states
        Sy = Sy.at[rows, output].set(resting)
        Sv = Sv.at[rows, output].set(moving)
        conditions.append(jnp.linalg.cond(matrix))
    return SteadyMotion(Sy, Sv), conditions


def operating_point(model: LinearPlant, position: Float[Array, " m"]) -> OperatingPoint:
    """Standstill at `position` where the model needs a control there, else the origin.

    A model that needs none stands anywhere alike: any point would do. So does one without steady
    motions, whose runs begin in a state that is given.
    """
    origin = OperatingPoint(
        jnp.zeros(model.axes, model.A.dtype),
        jnp.zeros(model.states, model.A.dtype),
        jnp.zeros(model.inputs, model.A.dtype),
    )
    if model.motion is None and _coupled_axis(model.pattern) is not None:
        return origin
    state = steady_motion(model).state(position, jnp.zeros_like(position))
    held = OperatingPoint(position, state, _holding(model.A, model.B, state))
    needed = jnp.any(jnp.abs(held.control) > 0)
    return jax.tree.map(lambda one, other: jnp.where(needed, one, other), held, origin)


@jax.jit
def _holding(A, B, rest):
    size = jnp.linalg.norm(B, axis=0)
    B, drift = B / size[None], rest - A @ rest
    held = small_solve(B.T @ B, B.T @ drift) / size
    stands = jnp.max(jnp.abs(drift)) <= ROUNDED * jnp.max(jnp.abs(rest))
    return jnp.where(stands, 0.0, held)


def _nonzero(matrix) -> tuple[tuple[bool, ...], ...]:
    if is_concrete(matrix):
        where = np.not_equal(np.asarray(matrix), 0)
    else:
        where = np.ones(matrix.shape, bool)
    return tuple(map(tuple, where.tolist()))


@jax.jit
def small_product(
    M: Float[Array | np.ndarray, "a b"], x: Float[Array | np.ndarray, " b"]
) -> Float[Array, " a"]:
    """Product M x.

    A small one is written as sums: XLA for CPUs joins them with what is around them in a loop's
    body, where every `@` is a step of its own that takes longer than its arithmetic.

    Raises:
        TypeError: x has not as many numbers as M has columns, as `@` has it.
    """
    if x.shape != M.shape[1:]:
        raise TypeError(f"x: needs shape {M.shape[1:]}, received {x.shape}")
    if max(M.shape) > LARGEST_SUMMED:
        return jnp.matmul(M, x)
    return jnp.sum(M * x[None], axis=1)
