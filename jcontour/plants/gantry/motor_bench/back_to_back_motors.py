"""Test bench of two motors on one shaft: MT1 drives, MT2 loads (Yuan, section 5.6.1).

    J_A theta_h'' = k_A i_x - b_r theta_h' - k_A i_T - F_fn,   theta_h = x_h / r_A      (5.45)
    M_A x_h'' = k_A i_x - b_A x_h' - k_A i_T - F_fn
    M_A = J_A / r_A [kg m],   b_A = b_r / r_A [N s]
Every term is a torque. So k_A is in N m/A, though the thesis calls it a force constant, and M_A is
no mass. k_A / M_A is in m/s^2 per A.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour._arrays import ranked
from jcontour._tracing import is_concrete
from jcontour.plants.friction import Friction

Shaft = Float[Array, "1"]  # the bench has one, and `Friction` is an array over axes


def _number(value) -> Float[Array, "..."]:
    return ranked(value, 1)


class BackToBackMotors(eqx.Module):
    """Two motors on one shaft, with all values taken at the shaft.

    Args:
        inertia: J_A [kg m^2] of both motors and the coupling.
        radius: r_A [m] of travel for an angle: x_h = r_A theta_h.
        torque_constant: k_A [N m/A] of either motor.
        friction: friction of the shaft: torques [N m] over its speed theta_h' [rad/s], dry F_fn
            and viscous b_r [N m s/rad].

    Raises:
        ValueError: the inertia, the radius or the torque constant is not above zero and finite, or
            there is friction for several shafts.
    """

    # `__check_init__` names a value of another shape
    inertia: Float[Array, "..."] = eqx.field(converter=_number, kw_only=True)
    radius: Float[Array, "..."] = eqx.field(converter=_number, kw_only=True)
    torque_constant: Float[Array, "..."] = eqx.field(converter=_number, kw_only=True)
    friction: Friction = eqx.field(kw_only=True)

    def __check_init__(self):
        for name in ("inertia", "radius", "torque_constant"):
            value = getattr(self, name)
            bad = is_concrete(value) and not (np.isfinite(value) & (value > 0)).all()
            if value.shape != (1,) or bad:
                found = np.asarray(value).squeeze()
                raise ValueError(
                    f"{name}: needs one number, finite and above zero, received {found}"
                )
        for name, value in vars(self.friction).items():
            if value.shape != (1,):
                found = f"{value.shape[0]} values of {name}"
                raise ValueError(f"friction: the bench has one shaft, received {found}")

    @property
    def reduced_inertia(self) -> Shaft:
        """Reduced inertia M_A = J_A / r_A [kg m]."""
        return self.inertia / self.radius

    @property
    def reduced_viscous(self) -> Shaft:
        """Reduced viscous friction b_A = b_r / r_A [N s]."""
        return self.friction.viscous / self.radius

    def acceleration(self, mode: Int[Array, "1"], speed: Shaft, torque: Shaft) -> Shaft:
        """Acceleration x_h'' [m/s^2], zero while the shaft sticks.

        Args:
            mode: 0 while the shaft sticks, else the direction of slip.
            speed: x_h' [m/s].
            torque: k_A (i_x - i_T) [N m].
        """
        resisting = self.friction.slipping(mode, speed / self.radius)
        return jnp.where(mode != 0, (torque - resisting) / self.reduced_inertia, 0)


def servo_bench() -> BackToBackMotors:
    """Pair of servo motors with our numbers: the thesis prints none of its bench."""
    friction = Friction(coulomb=0.02, stribeck=0.01, stribeck_speed=1.0, viscous=1e-3)
    return BackToBackMotors(inertia=1e-3, radius=0.02, torque_constant=0.5, friction=friction)
