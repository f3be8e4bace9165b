"""The X-Y table of Lam: a motor on each axis turns a lead screw through a spring and a damper.

    J_m ddpsi = K_t i - b_m dpsi - k_c (psi - phi) - c (dpsi - dphi) - T_m(dpsi)
    J_l ddphi = k_c (psi - phi) + c (dpsi - dphi) - b_l dphi - T_l(dphi)             (eqs 1-5)
    tool = tau phi
Fig. 4 prints J_t, b_t for J_l, b_l, and says identical where b_m, k_c and c differ. T is Coulomb
friction, which the paper has on the machine but not in its model.
"""

from dataclasses import dataclass, fields, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import check_above_zero, placed
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import zoh
from jcontour.plant import Plant

SUBSTEP = 5e-5  # [s] within which the friction torque is held
# [rad/s] over which Coulomb friction turns: smooth enough for a derivative, a hundredth of a
# working speed
TURNING = 0.5
POSITIVE = ("motor_inertia", "load_inertia", "torque_constant", "pitch")


@dataclass(frozen=True)
class DriveParameters:
    """Drive of one axis, Fig. 4.

    Raises:
        ValueError: an inertia, the torque constant or the pitch is not above zero, or another value
            is negative.
    """

    motor_inertia: float  # J_m [kg m^2]
    load_inertia: float  # J_l [kg m^2]
    motor_viscous: float  # b_m [N m s/rad]
    load_viscous: float  # b_l [N m s/rad]
    stiffness: float  # k_c [N m/rad]
    damping: float  # c [N m s/rad]
    torque_constant: float = 0.4364  # K_t [N m/A]
    pitch: float = 0.7958e-3  # tau [m/rad]

    def __post_init__(self):
        for field in fields(self):
            value, positive = getattr(self, field.name), field.name in POSITIVE
            enough = value > 0 if positive else value >= 0
            if not (np.isfinite(value) and enough):
                bound = "above" if positive else "at least"
                raise ValueError(
                    f"{field.name}: needs to be finite and {bound} zero, received {value}"
                )

    def scaled(
        self, inertia: float = 1.0, viscous: float = 1.0, link: float = 1.0, torque: float = 1.0
    ) -> "DriveParameters":
        """Drive of another machine, its values multiplied by these factors.

        Args:
            inertia: for both inertias.
            viscous: for both viscous terms.
            link: for stiffness and damping.
            torque: for the torque constant.
        """
        return replace(
            self,
            motor_inertia=inertia * self.motor_inertia,
            load_inertia=inertia * self.load_inertia,
            motor_viscous=viscous * self.motor_viscous,
            load_viscous=viscous * self.load_viscous,
            stiffness=link * self.stiffness,
            damping=link * self.damping,
            torque_constant=torque * self.torque_constant,
        )


X_DRIVE = DriveParameters(2.3e-5, 2.1e-5, 1.39e-4, 1e-3, 2.6682, 5e-4)
Y_DRIVE = DriveParameters(2.3e-5, 2.33e-5, 1.17e-4, 7.25e-4, 2.3017, 1.1e-3)


def xy_table(dt: float, drives: tuple[DriveParameters, ...] = (X_DRIVE, Y_DRIVE)) -> LinearPlant:
    """The table without Coulomb friction, exact at any sample period.

    State [psi, dpsi, phi, dphi] of every axis [rad, rad/s], control [A], output [m].

    >>> table = xy_table(1e-3)
    >>> start = table.initial_state(jnp.array([0.01, 0.02]), jnp.zeros(2))
    >>> start.shape, bool(jnp.allclose(table.output(start), jnp.array([0.01, 0.02])))
    ((8,), True)

    Raises:
        ValueError: `dt` is not above zero.
    """
    check_above_zero(dt=dt)
    A, torque, C = _continuous(drives)
    constants = np.array([drive.torque_constant for drive in drives])
    return LinearPlant(*zoh(A, torque[:, ::2] * constants, dt), C, dt)


class FrictionXYTable(Plant):
    """The table with Coulomb friction on motor and load.

        T = T_c tanh(omega / 0.5 rad/s)
    frozen over each substep.

    Args:
        dt: sample period [s].
        drives: the axes.
        motor_coulomb: T_c on the motor [N m]; not in the paper, chosen.
        load_coulomb: T_c on the lead screw [N m].
        load_torque: (m,) constant torque against the lead screws [N m].

    Raises:
        ValueError: `dt` is not a whole number of substeps, or a friction torque is negative.
    """

    A: Float[Array, "n n"]  # n = 4 m states of m axes
    B: Float[Array, "n m"]
    T: Float[Array, "n k"]  # of k = 2 m torques, motor and load of every axis
    C: Float[Array, "m n"]
    coulomb: Float[Array, " k"]
    load: Float[Array, " k"]
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def __init__(
        self,
        dt: float,
        drives: tuple[DriveParameters, ...] = (X_DRIVE, Y_DRIVE),
        motor_coulomb: float = 0.010,
        load_coulomb: float = 0.020,
        load_torque=0.0,
    ):
        positive = np.isfinite(dt) and dt > 0
        if not (positive and abs(round(dt / SUBSTEP) * SUBSTEP - dt) <= 1e-9 * dt):
            raise ValueError(
                f"dt: needs to be a whole number of substeps of {SUBSTEP} s, received {dt}"
            )
        self.dt, self.substeps = float(dt), round(dt / SUBSTEP)
        for name, value in (("motor_coulomb", motor_coulomb), ("load_coulomb", load_coulomb)):
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: needs to be at least zero, received {value}")
        A, torque, C = _continuous(drives)
        constants = np.array([drive.torque_constant for drive in drives])
        inputs = np.concatenate([torque[:, ::2] * constants, torque], axis=1)
        self.A, both = zoh(A, inputs, SUBSTEP)
        self.B, self.T = (placed(part) for part in np.split(np.asarray(both), [len(drives)], 1))
        self.C = placed(C)
        self.coulomb = placed(np.tile([motor_coulomb, load_coulomb], len(drives)))
        loads = jnp.broadcast_to(jnp.asarray(load_torque, float), (len(drives),))
        self.load = jnp.stack([jnp.zeros_like(loads), loads], axis=1).reshape(-1)

    def initial_state(self, position, increment) -> Float[Array, " n"]:
        pitch = jnp.diagonal(self.C[:, 2::4])
        angle, speed = jnp.asarray(position) / pitch, jnp.asarray(increment) / self.dt / pitch
        return jnp.stack([angle, speed, angle, speed], axis=-1).reshape(-1)

    def step(self, state, control) -> Float[Array, " n"]:
        pushed = self.B @ control - self.T @ self.load

        def substep(_, x):
            return self.A @ x + pushed - self.T @ (self.coulomb * jnp.tanh(x[1::2] / TURNING))

        return jax.lax.fori_loop(0, self.substeps, substep, state)

    def output(self, state) -> Float[Array, " m"]:
        return self.C @ state


def _continuous(drives: tuple[DriveParameters, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (4m, 4m), the map (4m, 2m) of torques on motor and load, and C (m, 4m), in SI units."""
    m = len(drives)
    A, torque, C = np.zeros((4 * m, 4 * m)), np.zeros((4 * m, 2 * m)), np.zeros((m, 4 * m))
    for i, d in enumerate(drives):
        axis = slice(4 * i, 4 * i + 4)
        on_motor = np.array([-d.stiffness, -d.motor_viscous - d.damping, d.stiffness, d.damping])
        on_load = np.array([d.stiffness, d.damping, -d.stiffness, -d.load_viscous - d.damping])
        A[axis, axis] = [
            [0, 1, 0, 0],
            on_motor / d.motor_inertia,
            [0, 0, 0, 1],
            on_load / d.load_inertia,
        ]
        torque[4 * i + 1, 2 * i] = 1 / d.motor_inertia
        torque[4 * i + 3, 2 * i + 1] = 1 / d.load_inertia
        C[i, 4 * i + 2] = d.pitch
    return A, torque, C
