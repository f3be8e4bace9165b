"""Acceleration that a control causes between the samples, and that the samples do not show.

A held control that alternates from sample to sample lets the tool swing at half the sampling rate.
A sampled double integrator has a zero at z = -1 there: its samples stand still while it swings. A
controller that costs little effort cancels zeros of this kind (Astrom, Hagander & Sternby, 1984),
and its samples look fine.
"""

from typing import cast

import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant

DEAD = 1e-9  # magnitude of a pole, below which its mode is a delay and no motion


def hidden_acceleration(plant: LinearPlant, delay: int = 0) -> Float[np.ndarray, "m p"]:
    """Acceleration [m/s^2 per unit] that alternates beside what the samples show.

    Under u(k) = (-1)^k the state is x(k) = (-1)^k s with s = -(I + A)^-1 B. The mean acceleration
    of the tool within a sample is 2 |V s| / dt with its speed V x, V = C log(A) / dt. The second
    difference of its samples has 4 |C s| / dt^2. What is hidden is the first one less the second,
    and not below zero.

    A mass of 2 kg under a force, sampled every 0.1 s, hides all of its acceleration:

    >>> mass = LinearPlant([[1.0, 0.1], [0.0, 1.0]], [[0.0025], [0.05]], [[1.0, 0.0]], dt=0.1)
    >>> hidden_acceleration(mass).round(9).tolist()
    [[0.5]]

    Args:
        plant: concrete; modes that end within a few samples, those of delays, have no speed.
        delay: samples by which its control is late, which `with_input_delay` gave it.
    """
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    swing = np.linalg.lstsq(np.eye(plant.states) + A, -B, rcond=None)[0]
    speed = C @ _rate(A, plant.dt) @ np.linalg.matrix_power(A, delay)
    within = 2 * np.abs(speed @ swing) / plant.dt
    shown = 4 * np.abs(C @ swing) / plant.dt**2
    return np.maximum(within - shown, 0.0)


def alternating(
    control: Float[Array | np.ndarray, "*runs T p"],
) -> Float[Array | np.ndarray, "*runs T-2 p"]:
    """Part of a control that alternates: |u(k+1) - 2 u(k) + u(k-1)| / 4.

    >>> alternating(np.array([[1.0], [-1.0], [1.0], [3.0], [5.0]])).ravel().tolist()
    [1.0, 0.0, 0.0]
    """
    before, now, after = control[..., :-2, :], control[..., 1:-1, :], control[..., 2:, :]
    return abs(after - 2 * now + before) / 4


def _rate(A: Float[np.ndarray, "n n"], dt: float) -> np.ndarray:
    """Generator log(A) / dt of the motion; complex where a pole is negative."""
    from scipy.linalg import logm, schur, solve_sylvester  # takes a while to load

    # a lambda: SciPy counts the arguments of the function, and sees none of a decorated one
    alive_first = schur(A.astype(complex), output="complex", sort=lambda pole: abs(pole) > DEAD)
    upper, basis, alive = cast(tuple[np.ndarray, np.ndarray, int], alive_first)
    if not alive:
        return np.zeros_like(A)
    motion, mixed, dead = upper[:alive, :alive], upper[:alive, alive:], upper[alive:, alive:]
    apart = solve_sylvester(motion, -dead, -mixed) if mixed.size else mixed
    back = np.hstack([np.eye(alive), -apart]) @ basis.conj().T  # onto the coordinates of the motion
    return basis[:, :alive] @ logm(motion) @ back / dt
