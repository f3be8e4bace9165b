"""Linear model of the emulated head, and the damping of the twist (Yuan, section 5.6.3).

    x_h'(k+1) = T k_x / M_e i_x(k-1) + (1 - T b_A / M_A) x_h'(k) + F_Nx(k)                (5.48)
    F_Nx(k) = T (b_A / M_A - b_x / M_e) x_h'(k-1) + T d_x(k-1) - T F_fn(k) / M_A          [m/s]
So the model has the bench's viscous friction. The head's is left to F_Nx, which the thesis takes
for a bounded disturbance.
"""

import jax.numpy as jnp

from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay, zoh
from jcontour.plants.gantry.motor_bench.back_to_back_motors import BackToBackMotors
from jcontour.plants.gantry.motor_bench.hardware_in_loop import HardwareInLoop
from jcontour.plants.gantry.parameters import GantryParameters, Scalar


def delayed_head_model(
    parameters: GantryParameters, bench: BackToBackMotors, dt: float
) -> LinearPlant:
    """Model (5.50) with the state (x_h, x_h', i_x(k-1)), by exact zero-order hold.

    The input is i_x, the output x_h. The thesis prints forward Euler. It is off by
    (T b_A / M_A)^2 / 2 of the speed. It also moves the position one sample late: by
    T^2 k_x / (2 M_e) for an ampere. F_Nx acts on both through the column of i_x, as
    M_e / (T k_x) F_Nx amperes.

    Raises:
        ValueError: `dt` is not above zero.
    """
    none, one = jnp.zeros(()), jnp.ones(())
    decay = (bench.reduced_viscous / bench.reduced_inertia)[0]
    A = jnp.stack([jnp.stack([none, one]), jnp.stack([none, -decay])])
    B = jnp.stack([none, parameters.head_constant / parameters.head_mass])[:, None]
    return with_input_delay(LinearPlant(*zoh(A, B, dt), jnp.eye(1, 2), dt), 1)


def twist_damping(plant: HardwareInLoop) -> Scalar:
    """Damping of the beam's twist without a controller [N m s/rad]; below zero the twist grows.

        2 b_y L^2 - M_e d^2 w sin((delay + 1/2) w T),   w^2 = 2 k_r / J_0
    for the head at the centre of the beam. The head acts on the twist by M_e d x_h'', eq. 5.9. The
    bench answers by x_h'' = -d theta'', half a sample late because it is held. This is of first
    order in M_e d^2 / J_0.
    """
    p = plant.gantry.parameters
    frequency = jnp.sqrt(2 * p.joint_stiffness / p.inertia(0.0))
    late = jnp.sin((plant.delay + 0.5) * frequency * plant.dt)
    return 2 * p.drive_viscous * p.half_span**2 - p.head_mass * p.tool_offset**2 * frequency * late
