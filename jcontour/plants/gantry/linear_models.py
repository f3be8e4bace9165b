"""The gantry as its controllers see it: linear around a position of the head, switched or scheduled over several (Yuan, section 5.3.1).

    x_h'' + b_x / M_e x_h' = k_x / M_e i_x + d_x                                              (5.13)
    M_t y_N'' + 2 b_y y_N' + m theta'' = k_y (i_1 + i_2) + d_1                                (5.14)
    m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta = k_y L (i_2 - i_1) + d_2            (5.15)
with m = M_e xbar - M_d L at the head position xbar, J = J(xbar). The thesis has M_d = 0; we keep
it. Its d_1, d_2 lack the terms in x_h - xbar and print "-d theta''" for "-d theta theta''";
`gantry_disturbances` has them whole. States in the order of `Gantry`.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import zoh
from jcontour.plant import Plant
from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.parameters import GantryParameters, Scalar, check_on_beam, untwisted
from jcontour.tracing import is_concrete

X, Y = (
    (0, 3),
    (1, 4, 2, 5),
)  # where the thesis's states (x_h, x_h') and (y_N, y_N', theta, theta') stand


class LinearGantry(NamedTuple):
    """dx/dt = A x + B u + E d, or one sample of it: u = (i_x, i_1, i_2) [A], d = (d_x [m/s^2], d_1 [N], d_2 [N m])."""

    A: Float[Array, "*batch 6 6"]
    B: Float[Array, "*batch 6 3"]
    E: Float[Array, "*batch 6 3"]

    def sampled(self, dt: float) -> "LinearGantry":
        """Exact zero-order hold of currents and disturbances."""
        A, both = zoh(self.A, jnp.concatenate([self.B, self.E], axis=1), dt)
        return LinearGantry(A, both[:, :3], both[:, 3:])


Linearisation = Callable[
    [GantryParameters, Scalar | float], LinearGantry
]  # at a head position [m]: `tangent` or `control_oriented`


def control_oriented(parameters: GantryParameters, head: Scalar | float) -> LinearGantry:
    """(5.13)-(5.15) at a head position [m].

    Raises:
        ValueError: the head is outside the beam.
    """
    mass = _mass_matrix(parameters, head)
    apart = mass.at[0, 1:].set(0).at[1:, 0].set(0)
    return _solved(
        parameters,
        apart,
        jnp.diag(jnp.array([1.0, 0, 0]) * parameters.head_mass + jnp.array([0, 1.0, 1.0])),
    )


def tangent(parameters: GantryParameters, head: Scalar | float) -> LinearGantry:
    """The derivative of the equation of motion at rest: (5.13)-(5.15) with M_e d theta'' and M_e d x_h'' kept; d acts as forces on q.

    Raises:
        ValueError: the head is outside the beam.
    """
    return _solved(parameters, _mass_matrix(parameters, head), jnp.eye(3))


def tool_plant(
    parameters: GantryParameters, head: Scalar | float, dt: float, linear: Linearisation = tangent
) -> LinearPlant:
    """A linear model, sampled, with the state (x_h, y_N - d, theta, rates), so that its outputs C x are the tool.

    Raises:
        ValueError: the head is outside the beam, or `dt` is not above zero.
    """
    A, B, _ = linear(parameters, head).sampled(dt)
    return LinearPlant(A, B, tool_matrix(parameters, head), dt)


def tool_matrix(parameters: GantryParameters, head) -> Float[Array, "2 6"]:
    """Tool (x_h + d theta, y_N - d + xbar theta) for small angles: C of the state with y_N - d."""
    return jnp.eye(2, 6).at[:, 2].set(jnp.stack([parameters.tool_offset, jnp.asarray(head, float)]))


def drive_response(
    parameters: GantryParameters, head, coupling
) -> tuple[Float[Array, "3"], Float[Array, "4"]]:
    """Numerator and denominator in s from the current i_1 to the speed y_1', highest power first, eq. 5.12.

        k_y ((J + L^2 M_t + 2 L m) s^2 + 4 b_y L^2 s + 2 k_r) / ((M_t s + 2 b_y) (J s^2 + 2 b_y L^2
        s + 2 k_r) - m^2 s^3)
    The thesis drops the coupling m, which moves its anti-resonance at 0.66 m from 45 Hz to 51.2 or
    40.6 Hz, by the side of the head.

    Args:
        parameters: of the machine.
        head: xbar [m].
        coupling: m [kg m]: 0 as printed, `head_mass * head` kept.
    """
    p = parameters
    L, b, k, J, m = p.half_span, p.drive_viscous, 2 * p.joint_stiffness, p.inertia(head), coupling
    numerator = p.drive_constant * jnp.stack([J + L**2 * p.total_mass + 2 * L * m, 4 * b * L**2, k])
    beam, twist = jnp.stack([p.total_mass, 2 * b]), jnp.stack([J, 2 * b * L**2, k])
    return numerator, jnp.convolve(beam, twist).at[0].add(-(m**2))


class _OverTheBeam(Plant):
    """What the switched and the scheduled model share: (5.13)-(5.15) sampled at several head positions."""

    parameters: GantryParameters
    points: Float[Array, " N"]
    models: LinearGantry
    dt: float = eqx.field(static=True)

    def __init__(self, parameters: GantryParameters, points, dt: float):
        points = jnp.asarray(points, float)
        if (
            points.ndim != 1
            or points.size == 0
            or (is_concrete(points) and not np.all(np.diff(points) > 0))
        ):
            raise ValueError(f"points: need head positions in rising order, received {points}")
        check_on_beam("points", points, parameters)
        if not (np.isfinite(dt) and dt > 0):
            raise ValueError(f"dt: needs to be finite and above zero, received {dt}")
        self.parameters, self.points, self.dt = parameters, points, float(dt)
        self.models = _sampled_models(parameters, points, self.dt)

    def initial_state(self, position, increment) -> Float[Array, "6"]:
        """No twist, the tool through `position`, at rest or at a steady speed."""
        return untwisted(self.parameters, position, jnp.asarray(increment) / self.dt)


class SwitchedGantry(_OverTheBeam):
    """Of several linear models the one whose point is nearest to the head (5.20), each meant for a half-width around its point.

    Args:
        parameters: of the machine.
        points: xbar_j [m], rising.
        half_width: of every region [m]; the regions touch.
        dt: sample period [s].

    Raises:
        ValueError: a point is outside the beam or out of order, the regions leave a gap, or `dt` is
            not above zero.
    """

    half_width: Scalar

    def __init__(self, parameters: GantryParameters, points, half_width: float, dt: float):
        super().__init__(parameters, points, dt)
        self.half_width = jnp.asarray(half_width, float)
        if is_concrete(points, half_width):
            gaps = np.diff(self.points)
            if not half_width > 0 or np.any(gaps > 2 * half_width * (1 + 1e-9)):
                needed = (
                    f"half the largest step of the points at least, {gaps.max(initial=0) / 2:g} m"
                )
                raise ValueError(f"half_width: needs to be {needed}, received {half_width}")

    def region(self, head) -> Int[Array, "*batch"]:
        """Index of the point nearest to a head position."""
        middles = (self.points[1:] + self.points[:-1]) / 2
        return jnp.searchsorted(middles, head)

    def check_covers(self, head) -> None:
        """Raise ValueError unless every head position of a path lies within a half-width of a point."""
        heads = np.asarray(head)
        away = np.abs(heads[..., None] - np.asarray(self.points)).min(axis=-1)
        if np.any(away > float(self.half_width) * (1 + 1e-9)):
            first, last = (
                float(self.points[0] - self.half_width),
                float(self.points[-1] + self.half_width),
            )
            raise ValueError(
                f"points: the models cover {first:g} to {last:g} m, the path goes from {heads.min():g} to {heads.max():g} m"
            )

    def step(self, state, control) -> Float[Array, "6"]:
        """A_j x + B_j u."""
        A, B, _ = jax.tree.map(lambda rows: rows[self.region(state[0])], self.models)
        return A @ state + B @ control

    def output(self, state) -> Float[Array, "2"]:
        """The tool [m], for small angles at the point."""
        return _tool(self.parameters, self.points[self.region(state[0])], state)


class ScheduledGantry(_OverTheBeam):
    """The linear models interpolated at the position of the head, and held beyond the first and the last point.

    Args:
        parameters: of the machine.
        points: xbar_j [m], rising.
        dt: sample period [s].

    Raises:
        ValueError: a point is outside the beam or out of order, or `dt` is not above zero.
    """

    def model(self, head) -> LinearGantry:
        """The sampled model at a head position."""

        def interpolated(rows):
            flat = rows.reshape(self.points.size, -1)
            return jax.vmap(lambda column: jnp.interp(head, self.points, column), in_axes=1)(
                flat
            ).reshape(rows.shape[1:])

        return jax.tree.map(interpolated, self.models)

    def check_covers(self, head) -> None:
        """Raise ValueError unless every head position of a path lies between the first and the last point."""
        heads, (first, last) = np.asarray(head), (float(self.points[0]), float(self.points[-1]))
        if heads.min() < first or heads.max() > last:
            raise ValueError(
                f"points: the models cover {first:g} to {last:g} m, the path goes from {heads.min():g} to {heads.max():g} m"
            )

    def step(self, state, control) -> Float[Array, "6"]:
        """A(x_h) x + B(x_h) u."""
        A, B, _ = self.model(state[0])
        return A @ state + B @ control

    def output(self, state) -> Float[Array, "2"]:
        """The tool [m], for small angles at the head."""
        return _tool(self.parameters, state[0], state)


@eqx.filter_jit
def _sampled_models(
    parameters: GantryParameters, points: Float[Array, " N"], dt: float
) -> LinearGantry:
    return jax.vmap(lambda head: control_oriented(parameters, head).sampled(dt))(points)


def _tool(parameters: GantryParameters, head, state) -> Float[Array, "2"]:
    return tool_matrix(parameters, head) @ state.at[1].add(-parameters.tool_offset)


def _mass_matrix(parameters: GantryParameters, head) -> Float[Array, "3 3"]:
    """M of the straight beam."""
    check_on_beam("head", head, parameters)
    head = jnp.asarray(head, float)
    return EquationOfMotion.of(parameters).mass_matrix(
        jnp.stack([head, jnp.zeros_like(head), jnp.zeros_like(head)])
    )


def _solved(
    p: GantryParameters, mass: Float[Array, "3 3"], push: Float[Array, "3 3"]
) -> LinearGantry:
    """q'' = M^-1 (currents + push d - friction - springs) as a first-order system."""
    motion, none = EquationOfMotion.of(p), jnp.zeros(())
    friction = jnp.stack([motion.head_viscous, motion.beam_viscous, motion.turning_viscous])
    springs = jnp.stack([none, none, motion.joints])
    k_x, k_y, k_t = motion.head_constant, motion.beam_constant, motion.turning_constant
    currents = jnp.stack(
        [jnp.stack([k_x, none, none]), jnp.stack([none, k_y, k_y]), jnp.stack([none, -k_t, k_t])]
    )
    columns = jnp.concatenate([-jnp.diag(springs), -jnp.diag(friction), currents, push], axis=1)
    rates = jnp.concatenate([jnp.eye(3, 12, 3), jnp.linalg.solve(mass, columns)])
    return LinearGantry(rates[:, :6], rates[:, 6:9], rates[:, 9:])
