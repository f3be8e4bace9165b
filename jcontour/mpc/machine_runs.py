"""Nominal runs of a machine itself, and its linear models along them.

    z(k+1) = f(z(k), v(k)),   A_k = df/dx, B_k = df/du, C_k = dy/dx at (z(k), v(k))
The run minimises sum |y(z(k)) - y_d(k)|^2 / length^2 + sum |v(k) - u(k)|^2 / size^2 around given
controls u, the inverse of the machine for one. Each round solves the linear-quadratic problem along
the run before and drives the machine with its gains (Li & Todorov 2004). Second derivatives of f
are left out, as Gauss and Newton do: the rounds converge linearly, the faster the smaller what is
left of the sums. A run that the next round would still change is refused. What is left between the
machine and these models is of second order in the deviation from the run.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.sets.responses import Numbers

SETTLED = 1e-6  # of a control's size: models and control fit the optimum to as many digits


class MachineRun(NamedTuple):
    """Run of S samples and the models along it.

    Attributes:
        state: z (S+1, n).
        control: v (S, p).
        output: y (S, m), the tool [m].
        A: (S, n, n).
        B: (S, n, p).
        C: (S, m, n).
    """

    state: Float[np.ndarray, "M n"]
    control: Float[np.ndarray, "S p"]
    output: Float[np.ndarray, "S m"]
    A: Float[np.ndarray, "S n n"]
    B: Float[np.ndarray, "S n p"]
    C: Float[np.ndarray, "S m n"]


def machine_run(
    plant: Plant,
    reference: Reference,
    controls: Numbers,
    length: float,
    size: Numbers,
    rounds: int = 3,  # from the inverse of a gantry the third changes rounding only
) -> MachineRun:
    """Run along all samples of a reference, preview included.

    Args:
        plant: smooth, its state a vector.
        reference: where the tool should be.
        controls: u (S, p).
        length: error that counts as much as `size` [m].
        size: deviation from the controls, one number or one per input.
        rounds: of improvement.

    Raises:
        ValueError: shapes do not fit, a size is not above zero, the run is not finite, or one more
            round would change a control by more than `SETTLED` of its size.
    """
    wanted, given = np.asarray(reference.position), np.asarray(controls, float)
    sizes = np.broadcast_to(np.asarray(size, float), given.shape[1:])
    if len(given) != len(wanted):
        raise ValueError(f"controls: needs {len(wanted)} samples, received {len(given)}")
    if not (length > 0 and (sizes > 0).all() and rounds >= 1):
        raise ValueError(f"length, size, rounds: need to be above zero, received {length}, {size}")
    start = plant.initial_state(reference.position[0], reference.start_increment)
    p, n = given.shape[1], start.shape[0]
    around, gains = np.zeros((len(given) + 1, n)), np.zeros((len(given), p, n))
    run = _driven(plant, start, around, gains, given)
    for _ in range(rounds):
        gains, pushes = _improved(run, wanted / length, given, length, sizes)
        run = _driven(plant, start, run.state, gains, pushes)
    _, pushes = _improved(run, wanted / length, given, length, sizes)
    change = float((np.abs(pushes - run.control) / sizes).max())
    if not change <= SETTLED:
        raise ValueError(
            f"rounds: after {rounds} the next would change a control by {change:.3g} of its size; "
            "more of them, or other controls to begin with"
        )
    return run


def _driven(plant, start, around, gains, pushes) -> MachineRun:
    """The machine under v = push + K (z - around), and the models along its run."""
    rows = (jnp.asarray(around[:-1]), jnp.asarray(gains), jnp.asarray(pushes))
    states, controls = _scanned(plant, start, rows)
    models = _linearised(plant, states[:-1], controls)
    run = MachineRun(*map(np.asarray, (states, controls, *models)))
    if not all(np.isfinite(leaf).all() for leaf in run):
        raise ValueError("controls: the machine's run along them is not finite")
    return run


@eqx.filter_jit
def _scanned(plant, start, rows):
    def step(state, row):
        near, gain, push = row
        control = push + gain @ (state - near)
        return plant.step(state, control), (state, control)

    last, (states, controls) = jax.lax.scan(step, start, rows)
    return jnp.concatenate([states, last[None]]), controls


@eqx.filter_jit
def _linearised(plant, states, controls):
    A, B = jax.vmap(jax.jacfwd(plant.step, (0, 1)))(states, controls)
    return jax.vmap(plant.output)(states), A, B, jax.vmap(jax.jacfwd(plant.output))(states)


def _improved(
    run: MachineRun, wanted: np.ndarray, given: np.ndarray, length: float, sizes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gains (S, p, n) and pushes (S, p) of the linear-quadratic problem along a run."""
    n, weight = run.A.shape[1], np.diag(1 / sizes**2)
    C, off = run.C / length, run.output / length - wanted
    P, pull = np.zeros((n, n)), np.zeros(n)  # the cost of what comes after the last sample
    gains, pushes = np.zeros((*run.control.shape, n)), run.control.copy()
    for k in range(len(given) - 1, -1, -1):
        A, B = run.A[k], run.B[k]
        inner, cross = weight + B.T @ P @ B, B.T @ P @ A
        slope = weight @ (run.control[k] - given[k]) + B.T @ pull
        answer = np.linalg.solve(inner, np.column_stack([cross, slope]))
        gains[k], step = -answer[:, :n], -answer[:, n]
        pushes[k] += step
        P = C[k].T @ C[k] + A.T @ P @ A + cross.T @ gains[k]
        P, pull = (P + P.T) / 2, C[k].T @ off[k] + A.T @ pull + cross.T @ step
    return gains, pushes
