"""Stiffness and damping of the link over the end effector's mass, from the two positions.

The end effector is driven by the motion of the motor alone, whatever moves the motor, so that
friction, cogging and the force scale play no part:

    d'' = -(k_s / M_e) d - (c_s / M_e) d' - x_m'',    d = x_e - x_m        (3.2) of Yuan
The measured motor position, a cubic spline through its samples, goes in; the simulated end effector
is fitted to the measured one. Under a piecewise linear acceleration, the spline's own, the
simulation is exact. An offset between the two encoders and the first deformation and its rate are
free in every record. Whole records count, stick and reversal included; the intervals are those of
`encoder_noise`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from tuning.identification.estimates import Estimate
from tuning.identification.flexible_axis.encoder_noise import encoder_noise, noise_correlation
from tuning.identification.flexible_axis.records import Record, with_tool
from tuning.identification.output_error import output_error

NAMES = ("stiffness_per_mass", "damping_per_mass")
OWN = 3  # free numbers of every record: offset, first deformation, its rate
LEAST, MOST = (
    2 * np.pi * 0.5,
    2 * np.pi * 0.1,
)  # [rad/s] slowest resonance looked for, and [rad/sample] the fastest
LINES, DAMPED = 40, 0.1  # resonances tried for a start, and twice their damping ratio


class LinkFit(NamedTuple):
    """k_s / M_e and c_s / M_e, the residual of the end effector's position, and its noise.

    Attributes:
        residuals: of every record (T,) [m].
        noise: standard deviation on motor and end effector, encoder counts included (R, 2) [m].
    """

    estimate: Estimate
    residuals: list[Float[np.ndarray, " _"]]
    noise: Float[np.ndarray, "R 2"]


def fit_link(records: Sequence[Record]) -> LinkFit:
    """Fit every record that has an end effector.

    Raises:
        ValueError: there is none, its end effector does not move against the motor, or no resonance
            is found.
    """
    records = with_tool(records)
    if not records:
        raise ValueError(
            "tool_position: no test has the end effector; "
            "stiffness, damping and its mass cannot be seen without"
        )
    signals = [_signals(record) for record in records]
    fit = output_error(_residual, signals, _start(signals), np.zeros((len(records), OWN)))
    if not (fit.converged and np.all(fit.shared > 0)):
        raise ValueError(
            "tool_position: no spring and damper explain how the end effector follows the motor; "
            "check signs and units"
        )
    noise = [
        encoder_noise(r, record.dt, fit.shared)
        for r, record in zip(fit.residuals, records, strict=True)
    ]
    correlations = [
        noise_correlation(s, record.dt, fit.shared, record.rows)
        for s, record in zip(noise, records, strict=True)
    ]
    return LinkFit(
        Estimate(NAMES, fit.shared, fit.covariance(correlations)), fit.residuals, np.array(noise)
    )


def _signals(record: Record) -> tuple[np.ndarray, np.ndarray, float]:
    """Acceleration of the motor, how far the end effector is from it, and the time between rows."""
    assert record.tool is not None
    apart = record.tool - record.motor
    if np.ptp(record.motor) == 0 or np.ptp(apart) == 0:
        still = "motor" if np.ptp(record.motor) == 0 else "end effector against the motor"
        raise ValueError(f"{record.name}: the {still} does not move")
    time = record.dt * np.arange(record.rows)
    return CubicSpline(time, record.motor)(time, 2), apart, record.dt


def _start(signals: Sequence[tuple]) -> Float[np.ndarray, " 2"]:
    """The best of a ladder of resonances, lightly damped."""
    fastest = MOST / max(dt for *_, dt in signals)
    tried = [np.array([w**2, DAMPED * w]) for w in np.geomspace(LEAST, fastest, LINES)]
    residual = jax.jit(_residual)
    return min(
        tried,
        key=lambda link: sum(
            float(jnp.var(residual(link, np.zeros(OWN), *one))) for one in signals
        ),
    )


def _residual(
    shared: Float[Array, " 2"], own: Float[Array, " 3"], acceleration, apart, dt
) -> Float[Array, " T"]:
    """Simulated minus measured d; k_s/M_e, c_s/M_e, and offset, first d, first d'."""
    (stiffness, damping), (offset, *first) = shared, own
    # one step of [d, d', a, slope of a], a linear in time
    A = jnp.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-stiffness, -damping, -1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 0.0, 0.0],
        ]
    )
    step = jax.scipy.linalg.expm(A * dt)[:2]
    pushes = jnp.stack([acceleration[:-1], jnp.diff(acceleration) / dt], axis=1) @ step[:, 2:].T
    (a, b), (c, d) = step[:, :2]

    def advance(state, push):
        return (
            a * state[0] + b * state[1] + push[0],
            c * state[0] + d * state[1] + push[1],
        ), state[0]

    state, deformation = jax.lax.scan(advance, tuple(first), pushes)
    return jnp.append(deformation, state[0]) + offset - apart
