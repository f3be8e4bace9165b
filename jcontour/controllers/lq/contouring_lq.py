"""Receding-horizon LQ contouring control (McNab & Tsao).

Over the next N_p samples, with e = y - y_d, minimise

    sum_j  stage_j (alpha |e_j|^2 + beta |(I - r r') e_j|^2) + rho |u_{j-1}|^2   + terminal
and apply the first control (eqs. 4-8, index j throughout). Lag along the path is forgiven, distance
from it is not.

The gains are planned ahead, u = f - F x without a memory. A drive that takes a position needs a
control u_0 to stand where a run begins, in the state x_0. The control costs what it differs from
that: the law is planned for the run moved to the origin,

    u = u_0 + f - F (x - x_0).
u_0 and x_0 are zero where a drive takes a speed or a force.
"""

import abc
from dataclasses import replace
from functools import partial
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour import _kernels as kernels
from jcontour._arrays import floating, is_concrete
from jcontour.controller import Controller, check_preview, warn_of_short_preview, whole_preview
from jcontour.linear.plant import (
    AffinePlan,
    LinearPlant,
    SteadyMotion,
    decoupled_axes,
    operating_point,
    small_product,
    steady_motion,
)
from jcontour.linear.small_matrices import small_solve
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare
from jcontour.riccati.decoupled import ContouringProblem, decoupled_plan, suits_decoupled
from jcontour.riccati.receding_horizon import CostToGo, output_cost, receding_horizon_plan


class PlannedFeedback(Controller):
    """Base of the LQ controllers: `prepare` makes F and f of every step, the rest is here."""

    follows_its_plan: ClassVar[bool] = True  # a kernel may compute the run

    def initial_memory(self, reference: Reference) -> None:
        return None

    def step(
        self, memory: None, plan: AffinePlan, measurement: Float[Array, " n"]
    ) -> tuple[None, Float[Array, " p"]]:
        """Control u = f - F x."""
        return None, plan.f - small_product(plan.F, measurement)


class ModelFeedback(PlannedFeedback):
    """Base of those with one model: their law is planned as if the run began at the origin."""

    model: eqx.AbstractVar[LinearPlant]

    @abc.abstractmethod
    def gain_schedule(self, reference: Reference) -> AffinePlan:
        """F and f of every step, for a reference that counts from the operating point."""

    def prepare(self, reference: Reference) -> AffinePlan:
        check_preview(self, reference)
        at = operating_point(self.model, reference.position[0])
        moved = replace(reference, position=reference.position - at.position[None])
        return self.gain_schedule(moved).at(at)


class LQWeights(eqx.Module):
    """Weights of the contouring cost; only alpha/rho and beta/rho matter.

    Args:
        alpha: weight on the tracking error [1/m^2].
        beta: weight on the contour error [1/m^2].
        rho: weight on the control [1/control unit^2]: one number for R = rho I, or the symmetric
            matrix R (p, p).
        stage: positive profile (N_p,) over the horizon, the last entry for the terminal; ones when
            not given.

    Raises:
        ValueError: a weight is negative or not finite, alpha and beta are both zero, rho (an
            eigenvalue) or a stage entry is not positive.
    """

    alpha: Float[Array, ""]
    beta: Float[Array, ""]
    rho: Float[Array, ""] | Float[Array, "p p"]
    stage: Float[Array, " N_p"] | None = None

    def __init__(self, alpha, beta, rho, stage=None):
        self.alpha, self.beta, self.rho = (floating(value) for value in (alpha, beta, rho))
        self.stage = None if stage is None else floating(stage)
        _check_weights(self)


class Terminal(eqx.Module):
    """Cost at the end of the horizon."""

    def settled(self, model: LinearPlant) -> int:
        """Samples before the end whose controls the terminal decides: its cost is that there."""
        return 0

    def check(self, model: LinearPlant, preview: int) -> None:  # noqa: B027
        """Warn of a horizon that this terminal is no good for."""

    @abc.abstractmethod
    def cost(
        self,
        model: LinearPlant,
        weights: LQWeights,
        Q: Float[Array, "S m m"],
        position: Float[Array, "S m"],
        ends: slice,
    ) -> CostToGo:
        """H and g at the ends of horizons, in front, before a stage profile scales them.

        Args:
            model: of the machine.
            weights: of the cost.
            Q: output weight at every sample.
            position: desired output at every sample [m].
            ends: samples that horizons end at, k + N_p; the first is not sample 0.
        """


class OutputTerminal(Terminal):
    """Terminal that weights the last error like the others; it does not assure stability.

    H = C' Q_Np C,   g = -C' Q_Np y_d(k + N_p)
    """

    def check(self, model: LinearPlant, preview: int) -> None:
        """Warn where no control acts on an axis within the horizon: its gains are then zero."""
        if not is_concrete(model.A, model.B, model.C):
            return
        A, acts, C = np.asarray(model.A), np.asarray(model.B), np.asarray(model.C)
        moved = np.zeros(model.axes, bool)
        for delay in range(1, model.states + 1):
            moved |= np.any(C @ acts, axis=1)
            if moved.all():
                return warn_of_short_preview(preview, delay)
            acts = A @ acts

    def cost(self, model, weights, Q, position, ends) -> CostToGo:
        """McNab & Tsao, eqs. 12 and 13, with the minus of the terminal g restored."""
        return output_cost(model, Q[ends], position[ends])


class RiccatiTerminal(Terminal):
    """Infinite-horizon cost under Q_max = (alpha + beta) I >= Q (McNab & Tsao, Theorem 1).

        H = H_s(Q_max),   g = -H_s x_d
    x_d continues the path at the speed it has at k + N_p (their Appendix). On straight lines every
    horizon is stable.

    Args:
        motion: maps from steady motion to the state; derived per decoupled axis when not given.
    """

    motion: SteadyMotion | None = None

    def cost(self, model, weights, Q, position, ends) -> CostToGo:
        """Cost under H_s of the continuation beyond the end of every horizon."""
        end = position[ends]
        before = position[ends.start - 1 : ends.stop - 1 : ends.step]
        motion = steady_motion(model) if self.motion is None else self.motion
        H = self.solution(model, weights)
        x_d = motion.state(end, end - before)
        return CostToGo(jnp.broadcast_to(H, (end.shape[0], *H.shape)), -x_d @ H)

    def solution(self, model: LinearPlant, weights: LQWeights) -> Float[Array, "n n"]:
        """Solution H_s(Q_max) of the Riccati equation."""
        Q_max = (weights.alpha + weights.beta) * model.C.T @ model.C
        return dare(model.A, model.B, Q_max, control_weight(model, weights))


class ContouringLQ(ModelFeedback):
    """Controller u = f - F x with gains made from the next `preview` samples of the path.

    >>> from jcontour.geometry.contours import circle
    >>> from jcontour.motion.references import along
    >>> from jcontour.plants.linear_machines import bridgeport
    >>> table = bridgeport()
    >>> controller = ContouringLQ(table, LQWeights(alpha=1e8, beta=1e9, rho=1e-2), preview=10)
    >>> path = along(circle(0.01), 2.5e-5 * np.arange(20), table.dt, preview=10, at_rest=False)
    >>> controller.prepare(path).F.shape
    (20, 2, 8)

    Args:
        model: model of the machine; the measurement is its state.
        weights: alpha, beta, rho and the stage profile.
        preview: horizon N_p [samples].
        terminal: cost at the end of the horizon.

    Raises:
        ValueError: preview not a whole number or < 1, a stage profile or a matrix rho of another
            size, a RiccatiTerminal without a stabilising solution.
    """

    model: LinearPlant
    weights: LQWeights
    preview: int = eqx.field(static=True)
    terminal: Terminal

    def __init__(
        self, model: LinearPlant, weights: LQWeights, preview: int, terminal: Terminal | None = None
    ):
        self.model, self.preview = model, whole_preview(preview)
        self.weights = weights = jax.tree.map(
            lambda weight: jnp.asarray(weight, model.A.dtype), weights
        )
        # the output terminal is the paper's better performing choice
        self.terminal = OutputTerminal() if terminal is None else terminal
        check_stage(weights, self.preview)
        self.terminal.check(model, self.preview)
        settled = self.terminal.settled(model)
        if settled and (self.preview <= settled or weights.stage is not None):
            raise ValueError(
                f"terminal: its state takes {settled} samples to reach, needs a longer preview and "
                f"no stage profile, received {self.preview}"
            )
        R = control_weight(model, weights)
        if isinstance(self.terminal, RiccatiTerminal):
            check_dare(model.A, model.B, (weights.alpha + weights.beta) * model.C.T @ model.C, R)

    def gain_schedule(self, reference: Reference) -> AffinePlan:
        problem = self.decoupled_problem(reference)
        if problem is not None:
            return decoupled_plan(problem)
        weights, model = self.weights, self.model
        stage = weights.stage
        if stage is None:
            stage = np.ones(self.preview, model.A.dtype)
        seen = reference.steps + self.preview
        Q = contour_weight(weights.alpha, weights.beta, reference.tangent[:seen])
        terminal = None
        if not isinstance(self.terminal, OutputTerminal):
            ends, settled = slice(self.preview, seen), self.terminal.settled(model)
            cost = self.terminal.cost(model, weights, Q, reference.position[:seen], ends)
            terminal = CostToGo(stage[-1] * cost.H, stage[-1] * cost.g)
            stage, seen = stage[: self.preview - settled], seen - settled
            Q = Q[:seen]
        R = control_weight(model, weights)
        if terminal is None and kernels.enabled():
            from jcontour._kernels import affine_runs  # loads Warp

            if affine_runs.suits_sweep(model, self.preview):
                in_jax = partial(receding_horizon_plan, terminal=None)
                y_d = reference.position[:seen]
                return affine_runs.swept_plan(model, Q, y_d, stage, R, in_jax)
        return receding_horizon_plan(model, Q, reference.position[:seen], stage, R, terminal)

    def decoupled_problem(self, reference: Reference) -> ContouringProblem | None:
        """Problem that needs no sweep: axes without coupling, a short window, output terminal."""
        weights, seen = self.weights, reference.steps + self.preview
        if type(self) is not ContouringLQ:  # a subclass may have another law
            return None
        if weights.rho.ndim or not isinstance(self.terminal, OutputTerminal):
            return None
        if not suits_decoupled(self.model.pattern, self.preview):
            return None
        cost = weights.alpha, weights.beta, weights.rho, weights.stage
        samples = reference.tangent[:seen], reference.position[:seen]
        return ContouringProblem(self.model, *cost, *samples, self.preview)


def check_stage(weights: LQWeights, preview: int) -> None:
    """Raise ValueError unless the stage profile has one entry for each preview sample."""
    if weights.stage is not None and weights.stage.shape != (preview,):
        needed = f"one entry per preview sample, shape ({preview},)"
        raise ValueError(f"stage: needs {needed}, received {weights.stage.shape}")


def contour_weight(
    alpha, beta, tangent: Float[ArrayLike, "*batch m"]
) -> Float[Array, "*batch m m"]:
    """Weight that forgives lag along the path: Q = alpha I + beta (I - r r').

    McNab & Tsao, eqs. 3 and 8; their eq. 19 prints the matrix for the normal's angle, `tangent` is
    the unit vector along the motion.
    """
    r = jnp.asarray(tangent)
    identity = jnp.broadcast_to(jnp.eye(r.shape[-1], dtype=r.dtype), (*r.shape, r.shape[-1]))
    return (alpha + beta) * identity - beta * r[..., :, None] * r[..., None, :]


def control_weight(model: LinearPlant, weights: LQWeights) -> Float[Array, "p p"]:
    """Weight R = rho I on the control, or R itself where rho is a matrix.

    Raises:
        ValueError: R is of another size.
    """
    rho, p = weights.rho, model.inputs
    if rho.shape not in ((), (p, p)):
        raise ValueError(f"rho: needs one number or shape ({p}, {p}), received {rho.shape}")
    return rho if rho.ndim else rho * np.eye(p, dtype=model.A.dtype)


def balanced(rho, inputs: int, first: int, second: int, difference) -> Float[ArrayLike, "p p"]:
    """Weight R that keeps two drives of one axis from fighting each other.

    u' R u = rho (|u|^2 + difference (u_first - u_second)^2)
    """
    apart = np.zeros(inputs)
    apart[first], apart[second] = 1.0, -1.0
    return rho * (np.eye(inputs) + difference * np.outer(apart, apart))


def _check_weights(weights: LQWeights) -> None:
    values = {name: getattr(weights, name) for name in ("alpha", "beta", "rho", "stage")}
    concrete = {
        name: np.asarray(v) for name, v in values.items() if v is not None and is_concrete(v)
    }
    if np.ndim(concrete.get("rho", 0.0)) == 2:
        concrete["rho"] = np.linalg.eigvalsh(concrete["rho"])
    for name, value in concrete.items():
        positive = name in ("rho", "stage")
        enough = value > 0 if positive else value >= 0
        if not (np.isfinite(value) & enough).all():
            bound = "above" if positive else "of at least"
            raise ValueError(f"{name}: needs a finite weight {bound} zero, received {value}")
    if {"alpha", "beta"} <= concrete.keys() and (concrete["alpha"] + concrete["beta"] == 0).any():
        raise ValueError(
            "alpha, beta: at least one of them needs to be above zero, received 0 and 0"
        )


UNREACHED = "model: the controls do not reach every state, no horizon ends in rest"
REACHED = 1e-12  # least singular value of what the controls reach, over the largest


class ZeroTerminal(Terminal):
    """Zero terminal state: the horizon ends on the continuation of the path, x(k + N_p) = x_d.

    McNab & Tsao, section 3, name this infinite weight as one way to a stable horizon (Kleinman
    1974; Kwon & Pearson 1977). x_d is derived per decoupled axis. The last d controls, as many as
    reach every state, are decided by it: of

        sum_{j<d} e_j' Q_j e_j + u_j' R u_j,   x_d given,
    the least value is quadratic in the state d samples before the end. That is the cost to go of a
    horizon that is d samples shorter. e_j is the output error j samples after that state.
    """

    def settled(self, model: LinearPlant) -> int:
        """Controls d that reach every state: of a part, as many as it has states for an input.

        Raises:
            ValueError: the controls do not reach every state; traced models pass unchecked.
        """
        parts = [part for part in decoupled_axes(model.pattern) if part.states]
        if any(not part.inputs for part in parts):
            raise ValueError(UNREACHED)
        d = max(-(-len(part.states) // len(part.inputs)) for part in parts)
        if is_concrete(model.A, model.B):
            A, B = np.asarray(model.A), np.asarray(model.B)
            columns = [B / np.linalg.norm(B, axis=0)]
            for _ in range(d - 1):
                columns.append(A @ columns[-1])
            reached = np.concatenate(columns, axis=1)
            size = np.abs(reached).max(axis=1, keepdims=True)
            sizes = np.linalg.svd(reached / np.where(size > 0, size, 1.0), compute_uv=False)
            if not sizes[-1] > REACHED * sizes[0]:
                raise ValueError(UNREACHED)
        return d

    def cost(self, model, weights, Q, position, ends) -> CostToGo:
        """Cost to go d samples before the ends of horizons."""
        A, B, C, d = model.A, model.B, model.C, self.settled(model)
        n, p = B.shape
        R = jnp.kron(jnp.eye(d), control_weight(model, weights))
        powers = [jnp.eye(n)]
        for _ in range(d):
            powers.append(powers[-1] @ A)
        none = jnp.zeros((n, p))
        forced = [
            jnp.concatenate([powers[j - i - 1] @ B if i < j else none for i in range(d)], axis=1)
            for j in range(d + 1)
        ]
        free, moved = C @ jnp.stack(powers[:d]), C @ jnp.stack(forced[:d])  # of the outputs
        count = position[ends].shape[0]
        first = ends.start - d
        windows = np.arange(first, first + count)[:, None] + np.arange(d)
        Q_d, y_d = Q[windows], position[windows]
        before = position[ends.start - 1 : ends.start - 1 + count]
        wanted = steady_motion(model).state(position[ends], position[ends] - before)
        # U = K x + k, stationary under the condition at the end; its rows are scaled to one
        unit = jnp.max(jnp.abs(forced[d]), axis=1, keepdims=True)
        end, size = forced[d] / unit, n + d * p
        W = R[None] + jnp.einsum("jap,tjab,jbq->tpq", moved, Q_d, moved)
        scale = jnp.max(jnp.abs(W), axis=(1, 2), keepdims=True)
        system = jnp.zeros((count, size, size)).at[:, : d * p, : d * p].set(W / scale)
        system = system.at[:, : d * p, d * p :].set(end.T).at[:, d * p :, : d * p].set(end)
        by_state = -jnp.einsum("jap,tjab,jbn->tpn", moved, Q_d, free) / scale
        by_path = jnp.einsum("jap,tjab,tjb->tp", moved, Q_d, y_d) / scale[:, :, 0]
        by_end = jnp.broadcast_to(-powers[d] / unit, (count, n, n))
        right = jnp.concatenate([by_state, by_end], axis=1)
        path = jnp.concatenate([by_path, wanted / unit.T], axis=1)
        answer = jax.vmap(small_solve)(system, jnp.concatenate([right, path[:, :, None]], axis=2))
        K, k = answer[:, : d * p, :n], answer[:, : d * p, n]
        outputs = free[None] + jnp.einsum("jap,tpn->tjan", moved, K)
        left = jnp.einsum("jap,tp->tja", moved, k) - y_d
        H = jnp.einsum("tjan,tjab,tjbm->tnm", outputs, Q_d, outputs) + K.mT @ (R @ K)
        g = jnp.einsum("tjan,tjab,tjb->tn", outputs, Q_d, left)
        return CostToGo(H, g + jnp.einsum("tpn,pq,tq->tn", K, R, k))
