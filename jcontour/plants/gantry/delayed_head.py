"""The emulated head as its controller sees it, and what the emulation does to the beam (Yuan, section 5.6.3).

    x_h'(k+1) = T k_x / M_e i_x(k-1) + (1 - T b_A / M_A) x_h'(k) + F_Nx(k)
    (5.48) F_Nx(k) = T (b_A / M_A - b_x / M_e) x_h'(k-1) + T d_x(k-1) - T F_fn(k) / M_A
    [m/s]
So the model has the bench's viscous friction; the head's is left to F_Nx, which the thesis takes
for a bounded disturbance.
"""

import jax.numpy as jnp

from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay, zoh
from jcontour.plants.gantry.back_to_back_motors import BackToBackMotors
from jcontour.plants.gantry.hardware_in_loop import HardwareInLoop
from jcontour.plants.gantry.parameters import GantryParameters, Scalar


def delayed_head_model(
    parameters: GantryParameters, bench: BackToBackMotors, dt: float
) -> LinearPlant:
    """(5.50) with the state (x_h, x_h', i_x(k-1)), the input i_x and the output x_h, by exact zero-order hold.

    The thesis prints forward Euler. It is off by (T b_A / M_A)^2 / 2 of the speed, and moves the
    position one sample later than the
    current does: by T^2 k_x / (2 M_e) for an ampere. F_Nx acts on both through the column of i_x,
    as M_e / (T k_x) F_Nx amperes.

    Raises:
        ValueError: `dt` is not above zero.
    """
    none, one = jnp.zeros(()), jnp.ones(())
    A = jnp.stack(
        [
            jnp.stack([none, one]),
            jnp.stack([none, -(bench.reduced_viscous / bench.reduced_inertia)[0]]),
        ]
    )
    B = jnp.stack([none, parameters.head_constant / parameters.head_mass])[:, None]
    return with_input_delay(LinearPlant(*zoh(A, B, dt), jnp.eye(1, 2), dt), 1)


def twist_damping(plant: HardwareInLoop) -> Scalar:
    """What damps the twist of the beam, with the head at its centre and no controller [N m s/rad]: below zero it grows by itself.

        2 b_y L^2 - M_e d^2 w sin((delay + 1/2) w T),   w^2 = 2 k_r / J_0
    M_e d x_h'' is what the head does to the twist, eq. 5.9, and x_h'' = -d theta'' what the bench
    makes of it, half a sample late for being held. To first order in M_e d^2 / J_0.
    """
    p = plant.gantry.parameters
    frequency = jnp.sqrt(2 * p.joint_stiffness / p.inertia(0.0))
    late = jnp.sin((plant.delay + 0.5) * frequency * plant.dt)
    return 2 * p.drive_viscous * p.half_span**2 - p.head_mass * p.tool_offset**2 * frequency * late
