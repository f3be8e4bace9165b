"""Reference and command governors around a linear loop (Garone, Di Cairano & Kolmanovsky 2017).

    scalar:  v = v(k-1) + kappa (r - v(k-1)), the largest kappa in [0, 1]
    vector:  v = arg min |v - r|
with (x, v) admissible, as below. With v(k-1) admissible at x(k-1) it stays so on the model,
so that an answer is always there and no limit is ever left. A scalar governor keeps the command on
the line to the reference, a vector one brings every axis as near as it can come. The wanted command
r + L dr leads by what the loop lags behind a steady motion.

Commands that a linear loop may be given for ever without leaving its limits.

    u = U v - K (x - X v),   x(k+1) = (A - B K) x + B (U + K X) v,   z = (y, u)
with X, U the state and the control at rest in v. A pair (x, v) is admissible where z_t stays within
its limits for all t with v held (Gilbert & Tan 1991). t = 0..s are rows; the resting z stays a
percent of the limits' width inside them, so that some s says the same as all later ones.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from scipy.optimize import linprog

from jcontour._arrays import is_concrete
from jcontour.controller import Controller, check_preview
from jcontour.controllers.feedback.state_feedback import moving_target
from jcontour.linear.plant import LinearPlant
from jcontour.linear.small_matrices import small_solve
from jcontour.motion.references import Reference
from jcontour.qp.interior_point import solve
from jcontour.qp.staged import StagedQP

Place = Float[Array, " m"]
INSIDE = 0.01  # of the half width: how far a resting loop stays within its limits
LONGEST = 2000  # samples that are looked ahead at most
SAID = 1e-7  # of the half width, by which a later row may be exceeded


class LoopLimits(NamedTuple):
    """Greatest magnitudes: of outputs from a centre [m], of controls; infinite ones are none."""

    output: tuple[float, ...]
    control: tuple[float, ...]
    centre: tuple[float, ...]

    @classmethod
    def of(cls, model: LinearPlant, control: ArrayLike, output: ArrayLike = np.inf, centre=0.0):
        """The limits, one number for all or one for each.

        Raises:
            ValueError: a limit is not above zero, or all of them are infinite.
        """
        sizes = {"output": (output, model.axes), "control": (control, model.inputs)}
        limits = {
            key: np.broadcast_to(np.asarray(one, float), n) for key, (one, n) in sizes.items()
        }
        for name, value in limits.items():
            if not np.all(value > 0):
                raise ValueError(f"{name}: needs limits above zero, received {value}")
        if not any(np.isfinite(value).any() for value in limits.values()):
            raise ValueError("limits: a governor needs a limit to keep, all of them are infinite")
        middle = np.broadcast_to(np.asarray(centre, float), model.axes)
        return cls(*(tuple(value.tolist()) for value in (*limits.values(), middle)))


class GovernedLoop(eqx.Module):
    """A loop and its admissible pairs: |state x + command v - centre| <= 1, row by row."""

    gain: Float[Array, "p n"]  # K
    feed: Float[Array, "p m"]  # U + K X, of the command in the control
    lag: Float[Array, "m m"]  # of the outputs behind a steady motion of the command [samples]
    # state, command, centre: rows, over their limits; those of z_t first, the resting ones last
    state: Float[Array, "r n"]
    command: Float[Array, "r m"]
    centre: Float[Array, " r"]

    def control(self, state: Float[Array, " n"], command: Float[Array, " m"]) -> Float[Array, " p"]:
        """Control of the loop at a command."""
        return self.feed @ command - self.gain @ state


def governed_loop(
    model: LinearPlant, gain: Float[ArrayLike, "p n"], limits: LoopLimits, steps: int
) -> GovernedLoop:
    """The loop of a gain K with the rows of `steps` samples ahead.

    Raises:
        ValueError: as `moving_target`.
    """
    K, target = jnp.asarray(gain, float), moving_target(model)
    loop, feed = model.A - model.B @ K, target.control + K @ target.state
    limit = np.array([*limits.output, *limits.control])
    kept = np.isfinite(limit)
    scale = jnp.asarray(limit[kept])[:, None]
    n, m, p = model.states, model.axes, model.inputs
    H = jnp.concatenate([model.C, -K])[kept] / scale
    L = jnp.concatenate([jnp.zeros((m, m)), feed])[kept] / scale
    middle = np.concatenate([limits.centre, np.zeros(p)])[kept] / limit[kept]

    def sample_on(carry, _):
        state, moved = carry  # x(t) = state x + moved v
        later = loop @ state, loop @ moved + model.B @ feed
        return later, (H @ state, H @ moved + L)

    start = jnp.eye(n), jnp.zeros((n, m))
    _, rows = jax.lax.scan(sample_on, start, length=steps + 1)
    by_state, by_command = (one.reshape(-1, one.shape[2]) for one in rows)
    rest = (H @ target.state + L) / (1 - INSIDE)
    settled = small_solve(jnp.eye(n) - loop, jnp.eye(n))
    return GovernedLoop(
        K,
        feed,
        model.C @ settled @ settled @ model.B @ feed,
        jnp.concatenate([by_state, jnp.zeros((len(middle), n))]),
        jnp.concatenate([by_command, rest]),
        jnp.concatenate([jnp.tile(middle, steps + 1), middle / (1 - INSIDE)]),
    )


def enough_steps(model: LinearPlant, gain: Float[ArrayLike, "p n"], limits: LoopLimits) -> int:
    """Least steps, of a series that grows by a half, whose rows say what all later ones do.

    Raises:
        ValueError: the loop is not stable, or takes more than 2000 samples.
    """
    steps = 8
    while steps <= LONGEST:
        if says_all(governed_loop(model, gain, limits, steps), limits):
            return steps
        steps += steps // 2
    raise ValueError(
        f"gain: the loop is not stable, or does not settle within {LONGEST} samples; "
        "no command is admissible for ever"
    )


def says_all(loop: GovernedLoop, limits: LoopLimits) -> bool:
    """Whether the rows of the last sample follow from those before: linear programs, one each.

    Then those of all later samples follow, too.
    """
    if not is_concrete(loop.state):
        return True
    each = int(np.isfinite([*limits.output, *limits.control]).sum())
    rows = np.concatenate([np.asarray(loop.state), np.asarray(loop.command)], axis=1)
    centre = np.asarray(loop.centre)
    last = np.arange(len(rows) - 2 * each, len(rows) - each)
    before = np.setdiff1d(np.arange(len(rows)), last)
    # coordinates of one size, in which the rows before are about as long as one another
    unit = np.maximum(np.abs(rows[before]).max(axis=0), 1e-300)
    A = np.concatenate([rows[before], -rows[before]]) / unit
    b = np.concatenate([1 + centre[before], 1 - centre[before]])
    for row in last:
        for sign in (1.0, -1.0):
            farthest = linprog(-sign * rows[row] / unit, A, b, bounds=(None, None), method="highs")
            if farthest.status != 0 or -farthest.fun > 1 + sign * centre[row] + SAID:
                return False
    return True


class Governor(Controller):
    """A loop whose command is governed; the measurement is the state, true or estimated.

    Args:
        loop: with its admissible pairs, see `governed_loop`.
    """

    loop: eqx.AbstractVar[GovernedLoop]

    @abc.abstractmethod
    def governed(self, state: Float[Array, " n"], before: Place, wanted: Place) -> Place:
        """Admissible command for a wanted one [m]."""

    def prepare(self, reference: Reference) -> Float[Array, "T m"]:
        """Wanted commands of every step [m].

        Raises:
            ValueError: the reference looks less far ahead than the governor, or goes where the
                loop cannot rest within its limits.
        """
        check_preview(self, reference)
        wanted = reference.position[: reference.steps]
        ahead = reference.position[1 : reference.steps + 1] - wanted
        resting = jnp.all(self.loop.state == 0, axis=1)
        off = jnp.abs(wanted @ self.loop.command.T - self.loop.centre[None])
        off = jnp.where(resting[None], off, 0.0)
        if is_concrete(off) and np.max(np.asarray(off)) > 1 + 1e-9:
            k = int(np.argmax(np.max(np.asarray(off), axis=1)))
            raise ValueError(
                f"reference: sample {k}, {np.asarray(wanted)[k]} m, is where the loop cannot rest "
                "within its limits"
            )
        return wanted + ahead @ self.loop.lag.T

    def initial_memory(self, reference: Reference) -> Place:
        """Command of the steady motion in which the run begins [m]."""
        return reference.position[0] + self.loop.lag @ reference.start_increment

    def without_planned_limits(self) -> "ScalarGovernor":
        """The loop whose command is the wanted one."""
        free = eqx.tree_at(
            lambda loop: (loop.state, loop.command, loop.centre),
            self.loop,
            replace_fn=jnp.zeros_like,
        )
        return ScalarGovernor(free)

    def step(
        self, memory: Place, plan: Place, measurement: Float[Array, " n"]
    ) -> tuple[Place, Float[Array, " p"]]:
        command = self.governed(measurement, memory, plan)
        return command, self.loop.control(measurement, command)

    def towards(self, state: Float[Array, " n"], before: Place, wanted: Place) -> Place:
        """Farthest admissible command on the line from one that is admissible."""
        loop = self.loop
        here = loop.state @ state + loop.command @ before - loop.centre
        way = loop.command @ (wanted - before)
        moving = jnp.abs(way) > 0
        left = (jnp.sign(way) - here) / jnp.where(moving, way, 1.0)
        part = jnp.clip(jnp.min(jnp.where(moving, left, jnp.inf)), 0.0, 1.0)
        return before + part * (wanted - before)


class ScalarGovernor(Governor):
    """One number for all axes: the command stays on the line to the reference."""

    loop: GovernedLoop
    preview: int = eqx.field(static=True, default=1)

    def governed(self, state: Float[Array, " n"], before: Place, wanted: Place) -> Place:
        """As far towards the wanted command as is admissible."""
        return self.towards(state, before, wanted)


class VectorGovernor(Governor):
    """Nearest admissible command: a quadratic program of as many numbers as there are axes."""

    loop: GovernedLoop
    preview: int = eqx.field(static=True, default=1)

    def governed(self, state: Float[Array, " n"], before: Place, wanted: Place) -> Place:
        """Nearest command, kept to the rows to the last digit by a scalar governor."""
        loop, m = self.loop, before.size
        # the program has a state that does nothing; its unit is what a row of the command bears
        unit = 1 / jnp.max(jnp.abs(loop.command))
        here = loop.state @ state + loop.command @ before - loop.centre
        rows = jnp.concatenate([jnp.zeros((here.size, 1)), loop.command * unit], axis=1)
        pull = jnp.concatenate([jnp.zeros(1), (before - wanted) / unit])
        none = jnp.zeros((1, 1))
        program = StagedQP(
            A=none,
            B=jnp.zeros((1, m)),
            c=none,
            x0=jnp.zeros(1),
            H=jnp.eye(1 + m)[None],
            h=pull[None],
            H_end=none,
            h_end=jnp.zeros(1),
            D=rows,
            lower=(-1 - here)[None],
            upper=(1 - here)[None],
            penalty=jnp.full(here.size, jnp.inf),
        )
        answer = solve(program)
        nearest = before + unit * answer.trajectory.stages[0, 1:]
        nearest = jnp.where(answer.solved, nearest, wanted)
        return self.towards(state, before, nearest)
