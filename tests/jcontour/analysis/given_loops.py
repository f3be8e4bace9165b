"""Loops of given matrices, and their peaks by python-control."""

from typing import Any

import control
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize_scalar

from jcontour._arrays import placed
from jcontour.analysis.sensitivity import encoding_of, frozen_family, host_peaks, probe_windows
from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_references
from tests.small_loops import OnPositions


class Law(OnPositions):
    """w+ = W w + E y, u = K w + D y."""

    W: Any
    E: Any
    K: Any
    D: Any

    @classmethod
    def static(cls, D):
        D = jnp.asarray(D, float)
        p, q = D.shape
        return cls(np.zeros((0, 0)), np.zeros((0, q)), np.zeros((p, 0)), D)

    def initial_memory(self, reference):
        return jnp.zeros(self.W.shape[0])

    def step(self, memory, plan, measurement):
        u = self.K @ memory + self.D @ measurement
        return self.W @ memory + self.E @ measurement, u


def transfer(system, z):
    """Values (F, outputs, inputs) of a state space at points z."""
    A, B, C, D = (np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D))
    shifted = z[:, None, None] * np.eye(len(A)) - A
    return C @ np.linalg.solve(shifted, np.broadcast_to(B + 0j, (z.size, *B.shape))) + D


def highest(system):
    """Peak of the largest singular value: a fine grid, refined where it is high."""

    def level(w):
        values = transfer(system, np.exp(1j * np.atleast_1d(w)))
        return np.linalg.svd(values, compute_uv=False)[:, 0]

    poles = system.poles()
    near = np.abs(np.angle(poles))[:, None] + (1 - np.abs(poles))[:, None] * np.linspace(-2, 2, 41)
    grid = np.concatenate([np.geomspace(1e-8, np.pi, 1500), np.linspace(1e-3, np.pi, 1500)])
    grid = np.unique(np.clip(np.concatenate([grid, near.ravel()]), 1e-9, np.pi))
    values = level(grid)
    best = values.max()
    for k in np.argsort(values)[-4:]:
        bounds = grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)]
        actual = minimize_scalar(
            lambda w: -level(w)[0], bounds=bounds, method="bounded", options={"xatol": 1e-12}
        )
        best = max(best, -actual.fun)
    return best


def peaks_by_control(P, K):
    """Ms and Mt of u = K y, y = P u, each at input and output."""
    actual = []
    for loop in (K * P, P * K):
        one = control.ss([], [], [], np.eye(loop.noutputs), loop.dt)
        S = control.feedback(one, loop, sign=1)
        actual.append((highest(S), highest(S - one)))
    return np.array(actual)


def samples_of(windows, reference):
    """Samples of one reference at which its windows begin."""
    starts = np.asarray(windows.position)[:, None, 0]
    away = np.linalg.norm(starts - np.asarray(reference.position)[: reference.steps], axis=2)
    return away.argmin(axis=1)


def plant_of(A, B, C):
    """Plant of these matrices; steady motions do not matter to a linear loop."""
    nothing = placed(np.zeros((len(A), len(C))))
    return LinearPlant(A, B, C, 1e-3, motion=SteadyMotion(nothing, nothing))


def straight_window(axes, preview=0):
    """One window of a straight line in motion."""
    there = line(np.zeros(axes), np.full(axes, 1e-2))
    run = along(there, 1e-5 * np.arange(4), 1e-3, preview, at_rest=False)
    return probe_windows(stack_references([run]), 1)


def loop_peaks(plants, controller, windows):
    """Peaks of frozen loops."""
    loops = jax.device_get(frozen_family(plants, controller, windows))
    return host_peaks(loops, encoding_of(plants, windows))
