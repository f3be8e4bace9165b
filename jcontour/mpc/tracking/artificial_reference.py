"""Tracking MPC whose reference is its own: any reference stays feasible (Limon, Alvarado 2008).

The artificial reference theta is a decision beside the controls. Over N samples, from theta_0 of
the sample before, minimise

    sum_j |x_j - x_s|^2_Q + |u_j - u_s|^2_R + pull |theta_j - r(k+j)|^2
        + |x_N - X theta_N|^2_P + pull |theta_N - r(k+N)|^2,   theta_{j+1} = theta_j + w_j
within the limits of outputs and controls. (x_s, u_s) is the steady motion through theta_j with the
increment w_j: theirs is one point at rest, this one moves with the reference as far as the limits
let it. P and K are those of the regulator. The horizon ends where theta_N is admissible for it for
ever (`governor`): so the last plan, moved on by a sample, keeps all limits, whatever r is.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour.controller import Controller, check_preview, whole_preview
from jcontour.controllers.feedback.governor import (
    GovernedLoop,
    LoopLimits,
    governed_loop,
    says_all,
)
from jcontour.controllers.feedback.state_feedback import SteadyTarget, moving_target
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.qp.interior_point import Answer, solve
from jcontour.qp.staged import StagedQP
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain

PRICE = 1e4  # of a limit on outputs or at the end that gives way, over the scaled cost


class ArtificialMemory(NamedTuple):
    """Memory: the artificial reference [m], and the steps so far that were not solved."""

    reference: Float[Array, " m"]
    failed: Int[Array, ""]


class ArtificialReferenceMPC(Controller):
    """Tracking MPC with an artificial reference; the measurement is the state.

    Limits of the controls hold in every plan. Those of outputs, and of the end of the horizon, are
    kept on the model; where a disturbance leaves them no answer, they give way at a high price. A
    step that is not solved has NaN for a control, and the memory counts it.

    Args:
        model: A, B, C.
        Q: weight on the state (n, n).
        R: weight on the controls (p, p).
        pull: weight on the distance of the artificial reference from the wanted one.
        limits: of outputs and controls.
        horizon: N [samples].
        steps: samples that the end of the horizon looks ahead, see `enough_steps`.

    Raises:
        ValueError: the Riccati equation has no stabilising solution, as `moving_target`, or the
            steps are too few.
    """

    model: LinearPlant
    target: SteadyTarget
    weights: tuple[Float[Array, "n n"], Float[Array, "p p"], Float[Array, "n n"]]
    pull: Float[Array, ""]
    loop: GovernedLoop
    row_limit: Float[Array, ""]  # of every row of the program, over its limit
    limits: LoopLimits = eqx.field(static=True)
    preview: int = eqx.field(static=True)

    def __init__(
        self,
        model: LinearPlant,
        Q: Float[ArrayLike, "n n"],
        R: Float[ArrayLike, "p p"],
        pull: ArrayLike,
        limits: LoopLimits,
        horizon: int,
        steps: int,
    ):
        Q, R = jnp.asarray(Q, float), jnp.asarray(R, float)
        check_dare(model.A, model.B, Q, R)
        P = dare(model.A, model.B, Q, R)
        self.model, self.target, self.weights = model, moving_target(model), (Q, R, P)
        self.loop = governed_loop(model, lqr_gain(model.A, model.B, P, R), limits, steps)
        if not says_all(self.loop, limits):
            raise ValueError(f"steps: {steps} are too few for the end of the horizon to say all")
        self.limits, self.preview = limits, whole_preview(horizon)
        self.pull, self.row_limit = jnp.asarray(pull, float), jnp.ones(())

    def without_planned_limits(self) -> "ArtificialReferenceMPC":
        """The plan that no limit bends."""
        return eqx.tree_at(lambda one: one.row_limit, self, jnp.asarray(jnp.inf))

    def prepare(self, reference: Reference) -> Float[Array, "T N m"]:
        """Wanted positions of samples 1..N of every step [m].

        Raises:
            ValueError: the reference looks less far ahead than the controller.
        """
        check_preview(self, reference)
        ahead = np.arange(reference.steps)[:, None] + np.arange(1, self.preview + 1)
        return reference.position[ahead]

    def initial_memory(self, reference: Reference) -> ArtificialMemory:
        """The artificial reference is where the run begins."""
        return ArtificialMemory(reference.position[0], jnp.zeros((), int))

    def step(
        self, memory: ArtificialMemory, plan: Float[Array, "N m"], measurement: Float[Array, " n"]
    ) -> tuple[ArtificialMemory, Float[Array, " p"]]:
        """First control and first artificial reference of the best plan."""
        n, m, p = self.model.states, self.model.axes, self.model.inputs
        answer = self.answer(memory, plan, measurement)
        first = answer.trajectory.stages[0, n + m :]
        step = first[p:] / jnp.max(jnp.abs(self.loop.command))
        moved = jnp.where(answer.solved, memory.reference + step, memory.reference)
        failed = memory.failed + jnp.where(answer.solved, 0, 1)
        control = self.target.control @ memory.reference + first[:p]
        return ArtificialMemory(moved, failed), jnp.where(answer.solved, control, jnp.nan)

    def answer(
        self, memory: ArtificialMemory, plan: Float[Array, "N m"], state: Float[Array, " n"]
    ) -> Answer:
        """The solved problem of a sample."""
        return solve(self.problem(memory, plan, state))

    def problem(
        self, memory: ArtificialMemory, plan: Float[Array, "N m"], state: Float[Array, " n"]
    ) -> StagedQP:
        """The quadratic program of a sample, over (x, theta, u, w)."""
        model, N, (Q, R, P), target = self.model, self.preview, self.weights, self.target
        n, m, p = model.states, model.axes, model.inputs
        eye, none = jnp.eye, jnp.zeros
        # counted from rest in the reference of before; theta in what the rows at the end bear
        unit = 1 / jnp.max(jnp.abs(self.loop.command))
        A = jnp.block([[model.A, none((n, m))], [none((m, n)), eye(m)]])
        B = jnp.block([[model.B, none((n, m))], [none((m, p)), eye(m)]])
        off = [eye(n), -unit * target.state, none((n, p)), -unit * target.state_moving]
        moved = [none((p, n)), -unit * target.control, eye(p), -unit * target.control_moving]
        off, moved = jnp.concatenate(off, axis=1), jnp.concatenate(moved, axis=1)
        pull = self.pull * unit**2
        pulled = jnp.diag(jnp.concatenate([none(n), jnp.ones(m), none(p + m)])) * pull
        stage, end = off.T @ Q @ off + moved.T @ R @ moved + pulled, off[:, : n + m]
        H_end = end.T @ P @ end + pulled[: n + m, : n + m]
        wanted = (plan - memory.reference[None]) / unit
        before = jnp.concatenate([none((1, m)), wanted[:-1]])  # theta_0 is given
        h = none((N, n + m + p + m)).at[:, n : n + m].set(-pull * before)
        h_end = none(n + m).at[n:].set(-pull * wanted[-1])
        D, resting, centre, acting, soft = self._rows(unit)
        middle = centre - resting @ memory.reference
        most = jnp.where(acting, self.row_limit, jnp.inf)
        lower, upper = middle[None] - most, middle[None] + most
        start = jnp.concatenate([state - target.state @ memory.reference, none(m)])
        H = jnp.broadcast_to(stage / pull, (N, *stage.shape))
        penalty = jnp.where(soft, PRICE, jnp.inf)
        return StagedQP(
            A,
            B,
            none((N, n + m)),
            start,
            H,
            h / pull,
            H_end / pull,
            h_end / pull,
            D,
            lower,
            upper,
            penalty,
        )

    def _rows(self, unit: Float[Array, ""]) -> tuple:
        """Rows over their limits, what a rest has in them by its place, their centre."""
        model, loop, limits, N = self.model, self.loop, self.limits, self.preview
        n, m, p = model.states, model.axes, model.inputs
        output, control = np.array(limits.output)[:, None], np.array(limits.control)[:, None]
        kept, driven = np.isfinite(output[:, 0]), np.isfinite(control[:, 0])
        widths, most = output[kept], control[driven]
        after = jnp.concatenate([model.A, jnp.zeros((n, m)), model.B, jnp.zeros((n, m))], axis=1)
        theta = jnp.eye(m, n + m + p + m, n) + jnp.eye(m, n + m + p + m, n + m + p)
        of_output = (model.C @ after)[kept] / widths
        of_control = jnp.eye(p, n + m + p + m, n + m)[driven] / most
        end = loop.state @ after + unit * loop.command @ theta
        resting = jnp.concatenate(
            [
                self.target.control[driven] / most,
                jnp.eye(m)[kept] / widths,
                loop.state @ self.target.state + loop.command,
            ]
        )
        counts = len(most), len(widths), end.shape[0]
        acting = np.ones((N, sum(counts)), bool)
        acting[:-1, counts[0] + counts[1] :] = False
        soft = np.repeat([False, True, True], counts)
        middle = jnp.asarray(np.array(limits.centre)[kept] / widths[:, 0])
        centre = jnp.concatenate([jnp.zeros(counts[0]), middle, loop.centre])
        return jnp.concatenate([of_control, of_output, end]), resting, centre, acting, soft
