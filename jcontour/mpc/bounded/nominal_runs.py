"""Nominal runs: a motion of the undisturbed model along a reference that is known as a whole.

    z(k+1) = A z(k) + B v(k)
It minimises sum |C z - y_d|^2 / length^2 + sum |v(k) - v(k-1)|^2 / size^2, the sizes of an error
and of a change of control that count alike. A change costs, a constant control does not: a slide
with viscous friction follows a ramp without error. The gain is stationary; all of the future acts
through one sweep backward.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from jcontour.linear.plant import LinearPlant, steady_motion
from jcontour.motion.references import Reference
from jcontour.sets.disturbed_model import Numbers


class NominalRun(NamedTuple):
    """States z (S+1, n) and controls v (S, p) of the undisturbed model at the S samples."""

    state: Float[np.ndarray, "M n"]
    control: Float[np.ndarray, "S p"]


def nominal_run(
    model: LinearPlant, reference: Reference, length: float, size: Numbers
) -> NominalRun:
    """Motion along all samples of a reference, preview included, from its steady start.

    >>> from jcontour import contours, feed_laws, references
    >>> from jcontour.plants import bridgeport
    >>> machine, circle = bridgeport(), contours.circle(1e-3)
    >>> arc = feed_laws.constant_feed(circle, 0.05, machine.dt)
    >>> reference = references.along(circle, arc, machine.dt, preview=30, at_rest=False)
    >>> run = nominal_run(machine, reference, length=1e-7, size=1.0)
    >>> error = run.state[:-1] @ np.asarray(machine.C).T - np.asarray(reference.position)
    >>> bool(np.abs(error[:-10]).max() < 5e-8)
    True

    Args:
        model: the machine.
        reference: where the tool should be.
        length: error that counts as much as `size` [m].
        size: change of the control per sample, one number or one per input.

    Raises:
        ValueError: a size is not above zero, or the machine cannot hold a steady motion.
    """
    n, p, m = model.states, model.inputs, model.axes
    changes = np.broadcast_to(np.asarray(size, float), (p,))
    if not (length > 0 and (changes > 0).all()):
        raise ValueError(f"length, size: need to be above zero, received {length} and {size}")
    A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
    wide = np.block([[A, B], [np.zeros((p, n)), np.eye(p)]])  # the state also holds v(k-1)
    entry = np.concatenate([B, np.eye(p)])
    shown = np.concatenate([C, np.zeros((m, p))], axis=1)
    # lengths in units of `length`, controls in units of `size`: the equation is well conditioned
    units = np.concatenate([np.full(n, length), changes])
    wide, entry = wide * units / units[:, None], entry * changes / units[:, None]
    shown = shown * units / length
    P = solve_discrete_are(wide, entry, shown.T @ shown, np.eye(p))
    inner = np.eye(p) + entry.T @ P @ entry
    K = np.linalg.solve(inner, entry.T @ P @ wide)
    future = np.linalg.solve(inner, entry.T)
    wanted = np.asarray(reference.position, float) / length
    ahead = _ahead((wide - entry @ K).T, wanted @ shown)
    motion = steady_motion(model)
    start = np.asarray(motion.state(reference.position[0], reference.start_increment))
    onward = reference.position[0] + reference.start_increment
    next_state = np.asarray(motion.state(onward, reference.start_increment))
    before = np.linalg.lstsq(B, next_state - A @ start, rcond=None)[0]
    return _run(wide, entry, K, future, ahead, np.concatenate([start, before]), units)


def _ahead(closed: np.ndarray, pulls: np.ndarray) -> np.ndarray:
    """What the future after every sample asks for: b_k = pull_{k+1} + closed' b_{k+1}.

    Beyond the last sample the reference stays where it is, until nothing more comes of it.
    """
    found = np.zeros((len(pulls), closed.shape[0]))
    later = np.linalg.solve(np.eye(len(closed)) - closed, pulls[-1])
    for k in range(len(pulls) - 1, -1, -1):
        found[k] = later
        later = pulls[k] + closed @ later
    return found


def _run(wide, entry, K, future, ahead, start, units) -> NominalRun:
    n = len(wide) - entry.shape[1]
    x, states, controls = start / units, [], []
    for later in ahead:
        states.append(x[:n])
        x = wide @ x + entry @ (future @ later - K @ x)
        controls.append(x[n:])
    states.append(x[:n])
    return NominalRun(np.array(states) * units[:n], np.array(controls) * units[n:])
