"""Zero terminal state: the horizon ends on the continuation of the path, x(k + N_p) = x_d.

McNab & Tsao, section 3, name this infinite weight as one way to a stable horizon (Kleinman 1974;
Kwon & Pearson 1977). The last d controls, as many as reach every state, are decided by it: of

    sum_{j<d} e_j' Q_j e_j + u_j' R u_j,   x_d given,
the least value is quadratic in the state d samples before the end. That is the cost to go of a
horizon that is d samples shorter. e_j is the output error j samples after that state.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete
from jcontour.controllers.lq.contouring_lq import LQWeights, Terminal, control_weight
from jcontour.linear.plant import LinearPlant, decoupled_axes, steady_motion
from jcontour.riccati.receding_horizon import CostToGo

UNREACHED = "model: the controls do not reach every state, no horizon ends in rest"
REACHED = 1e-12  # least singular value of what the controls reach, over the largest


class ZeroTerminal(Terminal):
    """The horizon ends in the steady motion of the path, derived per decoupled axis."""

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

    def cost(
        self,
        model: LinearPlant,
        weights: LQWeights,
        Q: Float[Array, "S m m"],
        position: Float[Array, "S m"],
        ends: slice,
    ) -> CostToGo:
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
        answer = jnp.linalg.solve(system, jnp.concatenate([right, path[:, :, None]], axis=2))
        K, k = answer[:, : d * p, :n], answer[:, : d * p, n]
        outputs = free[None] + jnp.einsum("jap,tpn->tjan", moved, K)
        left = jnp.einsum("jap,tp->tja", moved, k) - y_d
        H = jnp.einsum("tjan,tjab,tjbm->tnm", outputs, Q_d, outputs) + K.mT @ (R @ K)
        g = jnp.einsum("tjan,tjab,tjb->tn", outputs, Q_d, left)
        return CostToGo(H, g + jnp.einsum("tpn,pq,tq->tn", K, R, k))
