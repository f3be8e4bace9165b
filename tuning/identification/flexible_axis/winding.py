"""Resistance, inductance and back EMF of the motor from voltage, current and position.

With i_d = 0, (3.4) of Yuan is u_q = R i_q + L di_q/dt + k_e v. Between two rows the voltage is held
and v has the mean Delta x / dt, so

    i(k+1) = E i(k) + (1 - E) / R (u(k) - u_0 - k_e Delta x(k) / dt),    E = exp(-R dt / L)
with u_0 for the offsets of a real sensor. The first fit is linear least squares on (3.4) integrated
over a row,

    u dt = R dt (i(k) + i(k+1)) / 2 + L Delta i + k_e Delta x + u_0 dt,
which noise in the current biases a little. From there the simulated current is fitted to the
recorded one: only the voltage drives it, so that noise in the current does no harm, and the
residuals are those of the sensor.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tuning.identification.estimates import Estimate, autocorrelation
from tuning.identification.flexible_axis.records import Record, electrical
from tuning.identification.output_error import output_error

NAMES = ("resistance", "inductance", "back_emf")
CORRELATED = 5.0  # time constants of the winding over which residuals may be correlated
# of i_q, RMS, noise included: at such speeds w L is a hundredth of R, so that less i_d does no harm
STRAY = 0.2


class WindingFit(NamedTuple):
    """R, L, k_e, and what of the current they leave unexplained, record by record [A]."""

    estimate: Estimate
    residuals: list[Float[np.ndarray, " _"]]


def fit_winding(records: Sequence[Record]) -> WindingFit:
    """Fit every record that has a voltage.

    Raises:
        ValueError: there is none, i_d was not kept at zero, or voltage, current or motion is
            constant.
    """
    records = electrical(records)
    if not records:
        raise ValueError(
            "electrical: there is no test with a voltage; k_e, and with it k_t = 3/2 k_e, needs one"
        )
    for record in records:
        _check(record)
    fit = output_error(
        _residual,
        [_signals(record) for record in records],
        _linear(records),
        np.array([[r.current[0]] for r in records]),
    )
    if not (fit.converged and np.all(fit.shared[:3] > 0)):
        raise ValueError(
            "electrical: the fit gives a resistance, inductance or back EMF that is not above "
            "zero; check signs and units"
        )
    time_constant = fit.shared[1] / fit.shared[0]
    lags = int(np.ceil(CORRELATED * time_constant / min(record.dt for record in records)))
    covariance = fit.covariance([autocorrelation(fit.residuals, lags)] * len(records))
    return WindingFit(
        Estimate((*NAMES, "voltage_offset"), fit.shared, covariance).chosen(NAMES), fit.residuals
    )


def _check(record: Record) -> None:
    assert record.voltage is not None
    for name, values in (
        ("voltage", record.voltage),
        ("current", record.current),
        ("motor position", record.motor),
    ):
        if np.ptp(values) == 0:
            raise ValueError(
                f"{record.name}: the {name} is constant; "
                "the electrical test needs a moving motor and changing current"
            )
    if record.current_d is not None:
        stray = np.sqrt(np.mean(record.current_d**2) / np.mean(record.current**2))
        if stray > STRAY:
            raise ValueError(
                f"{record.name}: current_d is {100 * stray:.0f} % of current_q; "
                "the electrical test needs it kept at zero"
            )


def _linear(records: Sequence[Record]) -> Float[np.ndarray, " 4"]:
    """R, L, k_e and u_0 from the voltage integrated over every row."""
    columns, sides = [], []
    for record in records:
        assert record.voltage is not None
        i, h = record.current, record.dt
        columns.append(
            np.column_stack(
                [
                    (i[1:] + i[:-1]) / 2 * h,
                    np.diff(i),
                    np.diff(record.motor),
                    np.full(len(i) - 1, h),
                ]
            )
        )
        sides.append(record.voltage[:-1] * h)
    return np.linalg.lstsq(np.concatenate(columns), np.concatenate(sides), rcond=None)[0]


def _signals(record: Record) -> tuple:
    return record.voltage, record.current, np.diff(record.motor) / record.dt, record.dt


def _residual(
    shared: Float[Array, " 4"], start: Float[Array, " 1"], voltage, current, speed, dt
) -> Float[Array, " T"]:
    """Simulated minus recorded current; R, L, k_e, u_0, and the first current."""
    resistance, inductance, back_emf, offset = shared
    decay = jnp.exp(-resistance * dt / inductance)
    settled = (voltage[:-1] - offset - back_emf * speed) / resistance

    def advance(now, target):
        after = target + decay * (now - target)
        return after, after

    return jnp.append(start, jax.lax.scan(advance, start[0], settled)[1]) - current
