"""Reference and command governors around a linear loop (Garone, Di Cairano & Kolmanovsky 2017).

    scalar:  v = v(k-1) + kappa (r - v(k-1)), the largest kappa in [0, 1]
    vector:  v = arg min |v - r|
with (x, v) admissible: see `admissible`. With v(k-1) admissible at x(k-1) it stays so on the model,
so that an answer is always there and no limit is ever left. A scalar governor keeps the command on
the line to the reference, a vector one brings every axis as near as it can come. The wanted command
r + L dr leads by what the loop lags behind a steady motion.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete
from jcontour.controller import Controller, check_preview
from jcontour.controllers.feedback.admissible import GovernedLoop
from jcontour.motion.references import Reference
from jcontour.qp.interior_point import solve
from jcontour.qp.staged import StagedQP

Place = Float[Array, " m"]


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
        """Command: the place where the run begins [m]."""
        return reference.position[0]

    def step(
        self, memory: Place, plan: Place, measurement: Float[Array, " n"]
    ) -> tuple[Place, Float[Array, " p"]]:
        """Next command, and the control of the loop."""
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
