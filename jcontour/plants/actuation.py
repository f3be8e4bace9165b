"""Imperfections of an actuator: gains, limits, backlash, friction, loads and dead time."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float, Int
from scipy.linalg import schur, solve_sylvester

from jcontour._arrays import is_concrete
from jcontour.linear.plant import LinearPlant, decoupled_axes, small_product, spectral_radius
from jcontour.plant import Remembering, State, Wrapper
from jcontour.plants.friction import Friction


class Gained(Remembering):
    """A plant on which changes of control i act `gains[i]` times as much.

        u_acts(k) = u_0 + gains (u(k) - u_0)
    u_0 holds the plant at rest where the run begins. It is zero where a drive takes a speed or a
    force. A drive that takes a position needs more the farther it is from zero. A machine waits
    where a part begins, and a load observer has found by then what the gain is wrong by there. A
    gain that acts on u_0 as well would begin every run with a jump of (gains - 1) times the place
    of the part. It stands outside of a delay, whose line then holds the controls that act.

    The state keeps u_0 as whole numbers, its bits: it is no part of the loop, and frozen loops
    leave whole numbers as they are. No derivative goes through it.

    >>> from jcontour.linear.plant import LinearPlant
    >>> drive = LinearPlant([[0.9]], [[0.1]], [[1.0]], dt=1e-3)  # takes a position
    >>> plant = Gained(drive, jnp.array([1.5]))
    >>> rest = plant.initial_state(jnp.array([2.0]), jnp.zeros(1))
    >>> for control in (2.0, 3.0):
    ...     print(plant.output(plant.step(rest, jnp.array([control]))).round(9))
    [2.]
    [2.15]

    Args:
        plant: the machine.
        gains: relative, (p,) or one for all.

    Raises:
        ValueError: a gain is not finite and above zero.
    """

    gains: Float[Array, ""] | Float[Array, " p"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        if is_concrete(self.gains):
            gains = np.asarray(self.gains)
            if not np.all(np.isfinite(gains) & (gains > 0)):
                raise ValueError(f"gains: needs to be finite and above zero, received {gains}")

    def initial_state(self, position, increment) -> State:
        """State of the wrapped plant, and the bits of u_0."""
        held = jnp.asarray(self.plant.holding_control(position))
        bits = lax.bitcast_convert_type(held, f"int{8 * held.dtype.itemsize}")
        return self.plant.initial_state(position, increment), bits

    def step(self, state, control) -> State:
        inner, bits = state
        held = lax.bitcast_convert_type(bits, control.dtype)
        return self.plant.step(inner, held + self.gains * (control - held)), bits


class Saturated(Wrapper):
    """A plant whose control is limited to +-limit (p,) before it acts.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> table = Saturated(bridgeport(), jnp.array([10.0, 10.0]))
    >>> rest = table.initial_state(jnp.zeros(2), jnp.zeros(2))
    >>> pushed, limit = (table.step(rest, jnp.array([u, 0.0])) for u in (50.0, 10.0))
    >>> bool((pushed == limit).all())
    True

    Raises:
        ValueError: a limit is negative or not a number.
    """

    limit: Float[Array, " p"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        if is_concrete(self.limit) and not np.all(np.asarray(self.limit) >= 0):
            raise ValueError(f"limit: needs to be at least zero, received {self.limit}")

    def step(self, state, control) -> State:
        """Step of the wrapped plant under clip(u, -limit, limit)."""
        return self.plant.step(state, jnp.clip(control, -self.limit, self.limit))


class Backlash(Remembering):
    """A plant whose tool rests inside a gap until the motor pushes it.

        tool(k+1) = clip(tool(k), q(k+1) - gap / 2, q(k+1) + gap / 2)
    with the outputs q of the wrapped plant: the play operator, of a tool that friction holds. The
    measurement is that of the wrapped plant, at the motor. The tool starts behind the motion.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> loose = Backlash(bridgeport(), jnp.array([4e-6, 0.0]))
    >>> start = loose.initial_state(jnp.zeros(2), jnp.zeros(2))
    >>> loose.output(start).tolist()
    [0.0, 0.0]

    Args:
        plant: the machine with its encoders.
        gap: of every axis [m].
    """

    gap: Float[Array, " m"]

    def initial_state(self, position, increment) -> tuple:
        """The plant half a gap ahead of the tool, where it moves."""
        ahead = position + self.gap / 2 * jnp.sign(increment)
        return self.plant.initial_state(ahead, increment), jnp.asarray(position, float)

    def step(self, state, control) -> tuple:
        inner = self.plant.step(state[0], control)
        motor = self.plant.output(inner)
        return inner, jnp.clip(state[1], motor - self.gap / 2, motor + self.gap / 2)

    def output(self, state) -> Float[Array, " m"]:
        return state[1]


SLOWEST = 2e-4  # [m/s] within which friction turns, at least
INTEGRATOR = 3e-5  # distance of its pole from one: printed matrices are rounded
SLOPES = np.geomspace(0.1, 1e3, 81)  # of a force, over the inverse gain of what it acts on
ENDS, ABOUT_ONE = 0.2, 1e-6  # poles below are delays and filters; what rounding makes of one
LOST = 1e-6  # of a spectral radius, above what rounding makes of two poles at one
RESPONSE = 20  # samples of which the quickest counts
FAR = 1000  # samples after which an impulse has left the place where it brings the axis


class WithDryFriction(Wrapper):
    """A linear plant whose axes feel dry friction, which may be larger at rest.

        x(k+1) = x_f - B f,     x_f = A x + B u,     f = F(v) tanh(v / v_0),     v = S x_f
        F(v) = F_c + F_s 2^-(v / v_s)^2,             S = C (A - I) P / dt
    F_c and F_s are Coulomb's and Stribeck's part (`friction`). v is the speed that the axis would
    have without friction, as a rigid body: P projects on the modes that do not oscillate. With a
    delay in the model that is the speed when the control arrives, and the friction then arrives
    with it. It turns within v_0, at half of the slope F / v_0 at which the sampled loop of speed
    and friction is at the limit of stability. Of a mass that slope stops it within the sample: it
    sticks, and creeps only by what tanh is below one.

    A slide of 10 kg that is pushed with less than its friction hardly moves:

    >>> slide = LinearPlant([[1.0, 1e-3], [0.0, 1.0]], [[5e-8], [1e-4]], [[1.0, 0.0]], dt=1e-3)
    >>> rubbed = with_dry_friction(slide, np.asarray(slide.B), np.array([2.0]))
    >>> state = rubbed.initial_state(jnp.zeros(1), jnp.zeros(1))
    >>> for _ in range(1000):  # a second
    ...     state = rubbed.step(state, jnp.array([1.0]))
    >>> bool(rubbed.output(state)[0] < 0.5e-3)  # [m]
    True
    """

    entry: Float[Array, "n m"]
    speed: Float[Array, "m n"]
    sharpness: Float[Array, " m"]
    friction: Friction

    @property
    def force_terms(self) -> dict[str, Array]:
        one = self.friction
        size = jnp.ones(len(self.sharpness))
        each = (one.coulomb, one.stribeck, 1 / one.stribeck_speed**2)
        parts = self.entry, self.speed, self.sharpness, *(part * size for part in each)
        names = "ENTRY", "SPEED", "SHARPNESS", "FRICTION", "STRIBECK", "SOFTENING"
        return dict(zip(names, parts, strict=True))

    def step(self, state, control) -> Float[Array, " n"]:
        """x_f - B f."""
        free, one = self.plant.step(state, control), self.friction
        speed = small_product(self.speed, free)
        size = one.coulomb + one.stribeck * jnp.exp2(-((speed / one.stribeck_speed) ** 2))
        return free - small_product(self.entry, jnp.tanh(self.sharpness * speed) * size)


class ElastoplasticFriction(Remembering):
    """A plant whose drives hold their place against dry friction, which sticks.

        x(k+1) = A x + B u - E f(k+1),    f(k+1) = clip(f + s T (x(k+1) - x(k)), -F, F)
    Prandtl's operator. Friction turns within a travel T x of 2 F / s, and stays where the axis
    stands: a position loop rests up to F away from its command, F being the friction over the gains
    of its loops, as with no friction that turns with the speed. The plant starts behind the motion.

    Args:
        plant: a machine, some of whose controls are positions.
        entry: E, how a force on each axis enters.
        travel: T, the motion at the friction: C where encoder and friction are at one place.
        stiffness: s [control unit/m].
        friction: its Coulomb part is F of every control [control unit], zero of one that is none.
    """

    entry: Float[Array, "n m"]
    travel: Float[Array, "m n"]
    stiffness: Float[Array, " m"]
    friction: Friction

    @property
    def force_terms(self) -> dict[str, Array]:
        limit = jnp.broadcast_to(self.friction.coulomb, self.stiffness.shape)
        values = self.entry, self.travel, self.stiffness, self.kept, limit
        return dict(zip(("ENTRY", "TRAVEL", "STIFFNESS", "KEPT", "STICKING"), values, strict=True))

    @property
    def kept(self) -> Float[Array, " m"]:
        """What its own effect within a step leaves of a force: 1 / (1 + s T E), by axis."""
        return 1 / (1 + self.stiffness * jnp.sum(self.travel.T * self.entry, axis=0))

    def initial_state(self, position, increment) -> tuple:
        """Steady motion of the plant, under the friction where it moves."""
        force = self.friction.coulomb * jnp.sign(jnp.asarray(increment, float))
        return self.plant.initial_state(position, increment), force

    def step(self, state, control) -> tuple:
        """Step of the plant under the force that its travel leaves."""
        free, limit = self.plant.step(state[0], control), self.friction.coulomb
        way = jnp.sum(self.travel * (free - state[0])[None], axis=1)
        force = jnp.clip(self.kept * (state[1] + self.stiffness * way), -limit, limit)
        force = jnp.where(limit > 0, force, 0.0)  # nothing is remembered without friction
        return free - jnp.sum(self.entry * force[None], axis=1), force


def _calm_slope(
    A: np.ndarray, E: np.ndarray, rows: np.ndarray, gains: np.ndarray, at_once: bool = False
) -> np.ndarray:
    """Half of the slope s of a force f = s r x at which the loop loses stability, by axis."""
    # the loop has A - s E r, at once (I + s E r)^-1 A; s is looked for over the inverse gain
    slope = np.zeros(len(rows))
    for k, (column, row) in enumerate(zip(E.T, rows, strict=True)):
        series = SLOPES / max(float(gains[k]), 1e-300)
        pull = series[:, None, None] * np.outer(column, row)
        loops = np.linalg.solve(np.eye(len(A)) + pull, A[None]) if at_once else A - pull
        lost = np.flatnonzero(spectral_radius(loops) > max(float(spectral_radius(A)), 1.0) + LOST)
        slope[k] = series[lost[0] if lost.size else -1] / 2
    return slope


def _unbending(plant: LinearPlant) -> Float[np.ndarray, "n n"]:
    """Spectral projector on the modes that neither oscillate nor end within a sample or two."""
    A, onto = np.asarray(plant.A), np.zeros((plant.states, plant.states))
    for axis in decoupled_axes(plant.pattern):
        own = np.ix_(axis.states, axis.states)
        T, Z, *more = schur(
            A[own],
            output="complex",
            sort=lambda p: p.real > ENDS and abs(p.imag) < ABOUT_ONE + 0.1 * abs(1 - p.real),
        )
        count = int(more[0])
        X = solve_sylvester(T[:count, :count], -T[count:, count:], -T[:count, count:])
        basis = Z.conj().T
        onto[own] = np.real(Z[:, :count] @ (basis[:count] - X @ basis[count:]))
    return onto


def with_dry_friction(
    plant: LinearPlant,
    entry: Float[np.ndarray, "n m"],
    force: Float[np.ndarray, " m"],
    stribeck: tuple[ArrayLike, ArrayLike] = (0.0, 1.0),
) -> WithDryFriction | ElastoplasticFriction:
    """The plant with friction of every axis; it sticks where its drive takes a position.

    There springs may be between it and the encoder. Of the encoder's motion and of the part of that
    which does not oscillate, a motor's, it sticks by the one that allows it to be stiffer.

    Args:
        plant: without friction.
        entry: how a force on each axis enters whose drive takes a position, of one control unit: B
            where nothing is late.
        force: of each axis [control unit], at least zero.
        stribeck: what it is more at rest, and the speed at which half of that is left [m/s]; not
            of axes whose drives take positions.

    Raises:
        ValueError: a force is negative or not finite.
    """
    A, C = np.asarray(plant.A), np.asarray(plant.C)
    # axes whose part of the plant has a pole at one; the drives of the others take positions
    integrates = np.zeros(plant.axes, bool)
    for axis in decoupled_axes(plant.pattern):
        rows = np.array(axis.states)
        poles = np.linalg.eigvals(np.asarray(plant.A)[np.ix_(rows, rows)])
        integrates[list(axis.outputs)] = np.abs(poles - 1).min() < INTEGRATOR
    entry = np.where(integrates, np.asarray(plant.B), entry)
    more = np.where(integrates, stribeck[0], 0.0)
    sliding = Friction(np.where(integrates, force, 0.0), more, stribeck[1], 0.0)
    held = Friction(np.where(integrates, 0.0, force), 0.0, 1.0, 0.0)
    onto, after = _unbending(plant), np.linalg.pinv(np.eye(len(A)) - A) @ entry
    far = np.where(integrates, np.linalg.matrix_power(A, FAR) @ entry, after)
    entry, rigid = np.where(np.diagonal(C @ far) < 0, -entry, entry), C @ onto  # it brakes
    settled, motors = (np.abs(np.diagonal(rows @ after)) for rows in (C, rigid))
    slope, other = (_calm_slope(A, np.asarray(entry), rows, settled, True) for rows in (C, rigid))
    late = other * motors > slope * settled
    travel, stiffness = np.where(late[:, None], rigid, C), np.where(late, other, slope)
    holding = jnp.asarray(entry), jnp.asarray(travel), jnp.asarray(stiffness)
    if not integrates.any():
        return ElastoplasticFriction(plant, *holding, held)
    speed = (C @ A - C) @ onto / plant.dt
    powers = [np.linalg.matrix_power(A, k) @ entry for k in range(RESPONSE)]
    responses = [np.zeros(plant.axes), *(np.diagonal(speed @ one) for one in powers)]
    quickest = np.abs(np.diff(responses, axis=0)).max(axis=0)
    slope = _calm_slope(A, np.asarray(entry), speed @ A, quickest)
    turning = np.maximum(SLOWEST, (np.asarray(force) + more) / slope)
    parts = (jnp.asarray(part) for part in (entry, speed, 1.0 / turning))
    rubbed = WithDryFriction(plant, *parts, sliding)
    return rubbed if integrates.all() else ElastoplasticFriction(rubbed, *holding, held)


class Disturbed(Remembering):
    """A plant with sequences from outside: `force` adds to the control, `noise` to the measurement.

    The noise has one column for each number of the measurement, all its leaves in one row. The
    state carries a counter; beyond the end of a sequence its last row holds.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> noisy = Disturbed(bridgeport(), noise=1e-6 * jnp.ones((1, 8)))
    >>> noisy.measure(noisy.initial_state(jnp.zeros(2), jnp.zeros(2))).tolist()[:2]
    [1e-06, 1e-06]
    """

    force: Float[Array, "T p"] | None = None
    noise: Float[Array, "S q"] | None = None

    def initial_state(self, position, increment) -> State:
        return self.plant.initial_state(position, increment), jnp.zeros((), int)

    def step(self, state, control) -> State:
        """Step of the wrapped plant under u + force; the counter goes on."""
        inner, k = state
        if self.force is not None:
            control = control + _row(self.force, k)
        return self.plant.step(inner, control), k + 1

    def measure(self, state) -> Any:
        measurement = self.plant.measure(state[0])
        if self.noise is None:
            return measurement
        flat, shaped = ravel_pytree(measurement)
        return shaped(flat + _row(self.noise, state[1]))


def _row(sequence: Float[Array, "T d"], k: Int[Array, ""]) -> Float[Array, " d"]:
    return sequence[jnp.minimum(k, sequence.shape[0] - 1)]


class _LateControl(Remembering):
    """A plant whose control waits in a line of fixed `depth`, so that plants of any delay batch.

    The controller does not know it: it is fed the measurement of the undelayed part. The line
    starts with the control that holds the plant at rest, zero where drives take a speed or a force.
    So a run that starts in motion is pushed for the first samples, as the reference numbers of
    McNab and Tsao's late machines are.

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    samples: Int[Array, ""] | Float[Array, ""] = eqx.field(converter=jnp.asarray)
    depth: int = eqx.field(static=True)
    inputs: int = eqx.field(static=True)

    def __check_init__(self):
        if self.depth < 1:
            raise ValueError(
                f"depth: the delay line needs at least one place, received {self.depth}"
            )
        if is_concrete(self.samples):
            delays = np.asarray(self.samples)
            if not np.all((delays >= 0) & (delays <= self.depth)):
                raise ValueError(
                    f"samples: needs a delay from 0 to the depth {self.depth}, "
                    f"received {self.samples}"
                )

    def initial_state(self, position, increment) -> State:
        """State of the wrapped plant, and the control that holds it at rest in all of the line."""
        held = self.plant.holding_control(position)
        line = jnp.broadcast_to(held, (self.depth, self.inputs))
        return self.plant.initial_state(position, increment), line

    def step(self, state, control) -> State:
        inner, line = state
        after = self.plant.step(inner, self.acting(line, control))
        return after, jnp.concatenate([control[None], line])[:-1]

    @abc.abstractmethod
    def acting(
        self, line: Float[Array, "depth p"], control: Float[Array, " p"]
    ) -> Float[Array, " p"]:
        """Control that acts now (p,)."""


class Delayed(_LateControl):
    """A plant on which the control acts `samples` late, a whole number with a traced tap.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> late = Delayed(bridgeport(), 1, depth=2, inputs=2)
    >>> rest = late.initial_state(jnp.zeros(2), jnp.zeros(2))
    >>> plant_state, line = late.step(rest, jnp.array([10.0, 0.0]))
    >>> plant_state.tolist() == rest[0].tolist(), line.tolist()
    (True, [[10.0, 0.0], [0.0, 0.0]])

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    def acting(self, line, control) -> Float[Array, " p"]:
        """u(k - samples)."""
        return jnp.concatenate([control[None], line])[self.samples]


class PartlyDelayed(_LateControl):
    """A plant on which the control acts a part of a sample late, or several samples and a part.

        u_acts(k) = (1 - f) u(k - n) + f u(k - n - 1),   delay = n + f samples
    It is the mean over the sample of a control that is held and changes f of a sample late.

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    def acting(self, line, control) -> Float[Array, " p"]:
        """The mean of the two that act within the sample."""
        line = jnp.concatenate([control[None], line])
        whole = jnp.minimum(jnp.floor(self.samples), self.depth - 1)
        part, index = self.samples - whole, whole.astype(int)
        return (1 - part) * line[index] + part * line[index + 1]
