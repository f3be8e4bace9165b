"""The gantry with dry friction in its three guide ways: of the head on the beam, and of both drives.

    M_z z'' = f(z, z', u) - F_f        M_z, f and z = (x_h, y_1, y_2) as in `gantry_sliders`, F_f as
    in `friction`
The thesis's gantry has viscous friction only; the dry part is that of its chapter 3. A slider that
sticks is left out of the equation, and what its guide way has to hold follows from the motion of
the others, to which the mass matrix couples it.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour.plant import Plant
from jcontour.plants.friction import Friction, caught
from jcontour.plants.gantry.gantry import substeps_of
from jcontour.plants.gantry.parameters import GantryParameters, Scalar, untwisted
from jcontour.plants.gantry.sliders import SLIDERS, OfSliders, SliderEquation
from jcontour.plants.integrators import runge_kutta
from jcontour.tracing import is_concrete


class SlidingMotion(NamedTuple):
    """Positions and speeds of the sliders (z, z') [m, m/s], and whether each sticks (0) or slips (-1, 1)."""

    sliders: Float[Array, "6"]
    mode: Int[Array, "3"]


class _FrictionGantry(Plant):
    """What the true gantry and its smooth twin share: they integrate (z, z'), and measure (q, q') as `Gantry` does."""

    parameters: GantryParameters
    friction: Friction
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def __init__(
        self,
        parameters: GantryParameters,
        friction: Friction,
        dt: float,
        substeps: int | None = None,
    ):
        self.parameters, self.dt, self.substeps = parameters, float(dt), substeps_of(dt, substeps)
        self.friction = of_sliders(friction)

    def _start(self, position, increment) -> Float[Array, "6"]:
        return self.parameters.motors(
            untwisted(self.parameters, position, jnp.asarray(increment) / self.dt)
        )

    def output(self, state) -> Float[Array, "2"]:
        """The tool [m]."""
        return self.parameters.tool(self.measure(state)[:3])


class StickSlipGantry(_FrictionGantry):
    """The gantry with stick and slip. It has no useful derivative where it sticks: tune on `SmoothFrictionGantry`.

    Between substeps a slider whose speed has turned sticks, unless what is on it takes it on the
    other way at once, and one at rest breaks loose where more than f_c + f_s is on it. What is on
    it depends on which of the others slip, so that they break loose one after another, the most
    overloaded first.

    Args:
        parameters: of the machine.
        friction: of head, first and second drive; its viscous part adds to that of the parameters.
        dt: sample period [s].
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: `dt` is not above zero, the substep does not divide it, or the friction is that
            of another number of sliders.
    """

    def initial_state(self, position, increment) -> SlidingMotion:
        """No twist, the tool through `position`, at rest and stuck or at a steady speed.

        Raises:
            ValueError: the head would be outside the beam.
        """
        sliders = self._start(position, increment)
        return SlidingMotion(sliders, jnp.sign(sliders[3:]).astype(jnp.int32))

    def step(self, state: SlidingMotion, control) -> SlidingMotion:
        """Substeps of classical Runge-Kutta with the modes frozen in each."""
        equation, guides = SliderEquation.of(self.parameters), each(self.friction)

        def substep(_, state: SlidingMotion) -> SlidingMotion:
            sliders, mode = state
            slips = mode != 0

            def rates(x):
                z, v = x[:3], x[3:]
                masses, forces = equation.masses_and_forces(z, v, control)
                left = [
                    f - guide.slipping(s, speed)
                    for f, guide, s, speed in zip(forces, guides, mode, v, strict=True)
                ]
                return jnp.stack([*v, *masses.solved_for(slips, left)])

            return self._settled(
                equation,
                SlidingMotion(runge_kutta(rates, sliders, self.dt / self.substeps), mode),
                control,
            )

        return jax.lax.fori_loop(0, self.substeps, substep, self._settled(equation, state, control))

    def measure(self, state: SlidingMotion) -> Float[Array, "6"]:
        """(q, q')."""
        return self.parameters.coordinates(state.sliders)

    def _settled(self, equation: SliderEquation, state: SlidingMotion, control) -> SlidingMotion:
        """Modes for what follows: sliders at rest, or whose speed has turned, stick or break loose in the direction of what is on them."""
        z, v = state.sliders[:3], state.sliders[3:]
        mode = caught(state.mode, v)
        speed = _slipping(mode, v)
        masses, forces = equation.masses_and_forces(z, speed, control)
        for _ in range(SLIDERS):
            slipping = masses.solved_for(
                mode != 0, jnp.stack(forces) - self.friction.slipping(mode, speed)
            )
            load = jnp.stack(forces) - jnp.stack(masses.times(slipping))
            excess = jnp.where(
                mode == 0, jnp.abs(load) - self.friction.dry(jnp.zeros(SLIDERS)), -jnp.inf
            )
            mode = jnp.where(
                jnp.arange(SLIDERS) == jnp.argmax(excess), self.friction.released(mode, load), mode
            )
        return SlidingMotion(jnp.concatenate([z, _slipping(mode, v)]), mode)


class SmoothFrictionGantry(_FrictionGantry):
    """The differentiable twin: friction follows tanh(sharpness v).

    Args:
        parameters: as of the true gantry.
        friction: likewise.
        dt: sample period [s].
        sharpness: 1/speed [s/m] within which friction turns; stiff beyond 1 / substep times mass
            over force.
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: as `StickSlipGantry`, or the sharpness is not above zero.
    """

    sharpness: Scalar

    def __init__(
        self,
        parameters: GantryParameters,
        friction: Friction,
        dt: float,
        sharpness: float = 1e3,
        substeps: int | None = None,  # 1 mm/s
    ):
        super().__init__(parameters, friction, dt, substeps)
        if is_concrete(sharpness) and not np.all(
            np.isfinite(sharpness) & (np.asarray(sharpness) > 0)
        ):
            raise ValueError(f"sharpness: needs to be finite and above zero, received {sharpness}")
        self.sharpness = jnp.asarray(sharpness, float)

    def initial_state(self, position, increment) -> Float[Array, "6"]:
        """(z, z'): no twist, the tool through `position`, at rest or at a steady speed.

        Raises:
            ValueError: the head would be outside the beam.
        """
        return self._start(position, increment)

    def step(self, state, control) -> Float[Array, "6"]:
        """Substeps of classical Runge-Kutta."""
        equation, guides = SliderEquation.of(self.parameters), each(self.friction)

        @jax.checkpoint  # reverse mode computes a stage again instead of storing it
        def rates(x):
            z, v = x[:3], x[3:]
            masses, forces = equation.masses_and_forces(z, v, control)
            left = [
                f - guide.smooth(speed, self.sharpness)
                for f, guide, speed in zip(forces, guides, v, strict=True)
            ]
            return jnp.stack([*v, *masses.solved(left)])

        h = self.dt / self.substeps
        return jax.lax.fori_loop(0, self.substeps, lambda _, x: runge_kutta(rates, x, h), state)

    def measure(self, state) -> Float[Array, "6"]:
        """(q, q')."""
        return self.parameters.coordinates(state)


def _slipping(mode: Int[Array, "3"], speed: OfSliders) -> OfSliders:
    """Speeds of the sliders that move as their modes say, none of the others; a NaN stays one."""
    return jnp.where(mode * speed <= 0, 0, speed)


def each(friction: Friction) -> list[Friction]:
    """Slider by slider."""
    return [jax.tree.map(lambda values, k=k: values[k], friction) for k in range(SLIDERS)]


def of_sliders(friction: Friction) -> Friction:
    """One value for each slider.

    Raises:
        ValueError: there is another number of them.
    """
    for name, values in vars(friction).items():
        if values.shape[-1] not in (1, SLIDERS):
            raise ValueError(
                f"friction: {name} needs one value, or one each for the head and the two drives, received {values.shape[-1]}"
            )
    return jax.tree.map(lambda values: jnp.broadcast_to(values, (SLIDERS,)), friction)
