"""Largest tracking error of a flexible axis with stick, slip and cogging, proven.

The loop without dry friction and cogging is linear and does not change with time. Both act on the
motor as forces within bounds, free at every stage of every substep:


| the speed in a sample | dry friction |
|---|---|
| may turn | within +-(f_c + f_s), and what a stage may be off its substep |
| cannot: abs(v) - V - what a sample changes > 0 | sign known, size between dry(v) of its ends |

Cogging is that at x_m of the undisturbed run, within its slope times the tube of x_m. Sign and
cogging need the tubes at that sample only, so that one pass from the begin finds all. Known parts
move the undisturbed run; unknown ones make the tube: e(k) = e_run(k) +- B(k).

A slider that is caught stops at once. That is a friction of another size over this substep, and

    a small difference of what else the substep moves, taken as a column of its own;
    where the drive pushes harder than f_c + f_s against the motion that ends, a larger friction
    over one substep of the sample. A second time would need the drive to turn by 2 (f_c + f_s)
    within the sample, which is checked.

Over a substep the forces change, and a friction that replaces them does too. With F for the drive:

    the friction of a motor that sticks follows F from stage to stage, behind f_c + f_s;
    that of a stop is F and viscous friction on the mean of the stages. At one of them it is more,
    by as much as dry(v) is less there than on the mean. All speeds are near rest then.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jcontour.analysis.frozen_loops import unlimited
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.guarantees.affine import NotAffine
from jcontour.guarantees.disturbed_loop import DisturbedLoop, disturbed_loop
from jcontour.guarantees.friction.friction_columns import frictionless, sample_maps
from jcontour.motion.references import Reference
from jcontour.plants.flexible_axis.axis import AxisParameters, FlexibleAxis
from jcontour.plants.wrappers.encoders import FineEncoders
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate

ROUNDING = 1e-9  # relative, of the sums
MARGIN = 1.02  # of what is guessed within a sample; the guess is checked
# of the change of speed in a substep: the speed at a stage of one that begins at one side of rest
# and ends at the other, (k1 + 2 k2 + 2 k3 + k4) / 6 against k3 alone
STAGE = 4 / 3
GUESSES = 20
# v_m, x_m - x_e, v_e, x_m of (x_m, v_m, x_e, v_e)
INNER = np.array([[0.0, 1, 0, 0], [1, 0, -1, 0], [0, 0, 0, 1], [1, 0, 0, 0]])
BACK = np.linalg.inv(INNER)
TOOL, CONTROL, INTEGRAL = 4, 5, 6  # rows behind them


class FrictionBounds(NamedTuple):
    """Tracking errors at every sample.

    Attributes:
        bound: largest error of the tool [m].
        undisturbed: error of the run under what is known of friction and cogging [m].
        known: whether the sign of the friction is.
        control: largest |u|.
    """

    bound: Float[np.ndarray, " T"]
    undisturbed: Float[np.ndarray, " T"]
    known: Bool[np.ndarray, " T"]
    control: Float[np.ndarray, " T"]


def friction_bounds(
    axis: FlexibleAxis, cascade: Cascade, reference: Reference, resolution: float
) -> FrictionBounds:
    """Largest tracking errors of one axis behind encoders that count, from rest.

    Args:
        axis: with stick, slip and cogging.
        cascade: it reads position and speed of the motor as `CountingEncoders` give them.
        reference: from rest.
        resolution: of the encoder [m]; its rounding counts as an error of half a count, and of one
            count per sample of the speed.

    Raises:
        NotAffine: the control or the integrator may reach its limit.
        UnstableLoop: the loop is not stable.
        ValueError: several axes, a reference in motion, or forces that may turn within a sample.
    """
    if np.any(np.asarray(reference.start_increment) != 0):
        raise ValueError("reference: needs to begin at rest, where the motor sticks")
    plant = FineEncoders(frictionless(axis), Sensors((0,)))
    loop = disturbed_loop(plant, cascade, reference)
    run = simulate(plant, unlimited(cascade), reference)
    rows = (run.state[0] @ INNER.T, loop.output, loop.control, run.memory)
    free = np.concatenate([np.asarray(one) for one in rows], axis=1)
    noise = np.array([resolution / 2, resolution / axis.dt])
    return _Loop(axis, loop, noise).passed(free, reference, float(np.min(cascade.limit)))


class _Loop:
    """Answers of a loop that does not change with time, and the pass over its samples."""

    def __init__(self, axis: FlexibleAxis, loop: DisturbedLoop, noise: np.ndarray):
        self.M, self.sample = np.asarray(loop.M[0]), _Sample(axis)
        N, maps = self.M.shape[0], self.sample.maps
        lift, last = np.eye(N, 4), np.eye(1, N, N - 1)
        self.rows = np.concatenate([INNER @ lift.T, loop.C[0], loop.K[0], last])
        self.forced = lift @ maps.forced[-1]
        self.stopped, self.pushed = lift @ self.sample.stopped, lift @ self.sample.pushed
        self.noise = np.asarray(loop.E[0])[:, 1:] * noise
        self.direct = float(np.abs(np.asarray(loop.D[0])[0]) @ noise)

    def kernels(self, T: int) -> Float[np.ndarray, "T r 4"]:
        """Sizes of the answers of all rows after each lag, to every width and to the noise."""
        found, moving = np.zeros((T, len(self.rows), 4)), self.rows
        for lag in range(T):
            found[lag, :, 0] = np.abs(moving @ self.forced).sum(axis=1)
            found[lag, :, 1] = np.abs(moving @ self.stopped).sum(axis=1)
            found[lag, :, 2] = np.abs(moving @ self.pushed).max(axis=1)
            found[lag, :, 3] = np.abs(moving @ self.noise).sum(axis=1)
            moving = moving @ self.M
        return found

    def passed(
        self, free: Float[np.ndarray, "T r"], reference: Reference, limit: float
    ) -> FrictionBounds:
        """All samples, one after the other; `free` are the rows without dry friction and cogging.

        Raises:
            NotAffine: a limit may be reached.
        """
        T = len(free)
        kernels, z = self.kernels(T), np.zeros(self.M.shape[0])
        widths, now, tubes = np.ones((T, 4)), free.copy(), np.zeros_like(free)
        known = np.zeros(T, bool)
        for k in range(T):
            now[k] += self.rows @ z
            tubes[k] = np.einsum("jrw,jw->r", kernels[:k], widths[:k][::-1])
            tubes[k, CONTROL] += self.direct
            largest = abs(now[k, CONTROL]) + tubes[k, CONTROL]
            acting = self.sample.acting(now[k, :4], tubes[k, :4], largest)
            known[k], widths[k, :3] = acting.known, acting.widths
            z = self.M @ z + self.forced.sum(axis=1) * acting.centre
        sizes = (1 + ROUNDING) * (np.abs(now) + tubes)
        _check_limit(sizes, limit)
        error = now[:, TOOL] - np.asarray(reference.position)[:T, 0]
        bound = (1 + ROUNDING) * (np.abs(error) + tubes[:, TOOL])
        return FrictionBounds(bound, error, known, sizes[:, CONTROL])


def _check_limit(sizes: np.ndarray, limit: float) -> None:
    for name, row in (("control", CONTROL), ("integrator", INTEGRAL)):
        if sizes[:, row].max() >= limit:
            raise NotAffine(
                f"limit: a {name} of up to {sizes[:, row].max():.4g} may reach its limit of "
                f"{limit:.4g}; the loop is not linear there"
            )


class _Acting(NamedTuple):
    """Force on the motor in one sample: what is known, and sizes of what is not.

    The widths are of the force at every stage, of friction that a stop may be off, and of friction
    beyond its bounds over one substep.
    """

    centre: float
    known: bool
    widths: tuple[float, float, float]


class _Inside(NamedTuple):
    """Largest values within one sample, at every stage."""

    speed: float  # |v_m|
    quickest: float  # |dv_m/dt|
    drive: float  # force on the motor without its friction
    varied: float  # change over a substep of this force, and of all friction near rest
    turned: float  # change of it over the sample


class _Sample:
    """One sample of the axis, from what is known at its begin."""

    def __init__(self, axis: FlexibleAxis):
        self.maps, self.dt, self.h = sample_maps(axis), axis.dt, axis.dt / axis.substeps
        p = self.parameters = jax.tree.map(np.asarray, axis.parameters)
        self.mass, self.tool_mass = float(p.motor_mass[0]), float(p.tool_mass[0])
        self.stiffness, self.damping = float(p.stiffness[0]), float(p.damping[0])
        self.most = self._dry(0.0)
        self.viscous, self.constant = float(p.friction.viscous[0]), float(p.force_constant[0])
        self.cogging = cogging_size(p)
        self.free = INNER[:3] @ self.maps.free @ BACK
        self.driven = np.abs(self.maps.driven @ INNER[:3].T)
        self.forced = np.abs(INNER[:3] @ self.maps.forced).sum(axis=2)
        self.pushed = self.maps.later(self.maps.pushed)
        # a stop takes the speed to zero and leaves the rest as it was
        self.stopped = self.maps.later(self.maps.pushed * np.array([1.0, 0.0, 1.0, 1.0]))
        self.force_at = eqx.filter_jit(axis.parameters.cogging)

    def acting(self, now: np.ndarray, tube: np.ndarray, control: float) -> _Acting:
        """Force in the sample that begins at `now` within `tube`, rows as INNER.

        Raises:
            ValueError: the force may turn twice, so that there is no bound.
        """
        size = np.abs(now) + tube
        inside = self._inside(size, control, self.most, 0.0, 0.0)
        change = np.abs(self.free[:, 0] - np.eye(1, 4)) @ size
        change = (
            change + self.driven[:, 0] * control + self.forced[:, 0] * (self.most + self.cogging)
        )
        slowest = abs(now[0]) - tube[0] - change.max() - self.h * inside.quickest
        if slowest > 0:
            centre, width = self._cogging(now[3], tube[3], inside.speed)
            ends = [self._dry(v) for v in (slowest, inside.speed)]
            middle, half = sum(ends) / 2, (ends[0] - ends[1]) / 2
            return _Acting(centre - np.sign(now[0]) * middle, True, (half + width, 0.0, 0.0))
        varied = excess = 0.0
        for _ in range(GUESSES):
            friction = self.most + varied
            inside = self._inside(size, control, friction, excess, 2 * friction + excess)
            needed = max(0.0, inside.drive + inside.varied - self.most)
            if needed <= excess and inside.varied <= varied:
                break
            varied, excess = MARGIN * inside.varied, MARGIN * needed
        else:
            raise ValueError("axis: no bound closes within a sample of this motion")
        if inside.turned >= 2 * self.most:
            raise ValueError("axis: the force on the motor may turn within a sample; no bound")
        centre, width = self._cogging(now[3], tube[3], inside.speed)
        return _Acting(centre, False, (friction + width, 2 * friction + excess, excess))

    def _cogging(self, at: float, tube: float, speed: float) -> tuple[float, float]:
        """Known part of the cogging's force on the motor, and size of the rest."""
        width = cogging_slope(self.parameters) * (tube + (self.dt + self.h) * speed)
        if width > self.cogging:
            return 0.0, self.cogging
        return -float(self.force_at(jnp.full(1, at))[0]), width

    def _dry(self, speed: float) -> float:
        return float(self.parameters.friction.dry(jnp.full(1, speed))[0])

    def _inside(
        self, size: np.ndarray, control: float, friction: float, excess: float, stop: float
    ) -> _Inside:
        """Largest values at the stages: those at the substeps' ends, and what a stage may add.

        The rates are guessed and checked: every stage starts at the end of a substep and moves by
        the rates of the stage before. `friction` bounds the dry one at every stage.
        """
        force = friction + self.cogging
        ends = np.abs(self.free) @ size + self.driven * control + self.forced * force
        ends = np.maximum(ends.max(axis=0), size[:3])
        ends = ends + np.abs(INNER[:3] @ self.pushed).max(axis=1) * excess
        ends = ends + np.abs(INNER[:3] @ self.stopped).sum(axis=1) * stop
        rates = np.zeros(2)
        for _ in range(GUESSES):
            speed, tool = ends[0] + self.h * rates[0], ends[2] + self.h * rates[1]
            bend = ends[1] + self.h * (speed + tool)
            link = self.stiffness * bend + self.damping * (speed + tool)
            drive = self.constant * control + self.cogging + link
            all_forces = drive + friction + excess + self.viscous * speed
            found = np.array([all_forces / self.mass, link / self.tool_mass])
            if np.all(found <= rates):
                break
            rates = MARGIN * found
        else:
            raise ValueError("axis: its substeps are too long for a bound within them")
        springs = self.stiffness * (speed + tool) + self.damping * rates.sum()
        near_rest = self.most - self._dry(STAGE * self.h * rates[0])
        varied = self.h * (springs + self.viscous * rates[0]) + near_rest
        turned = 2 * self.cogging + 2 * link
        return _Inside(speed, rates[0], drive, varied, turned)


def cogging_size(parameters: AxisParameters) -> float:
    """Bound of |F_c| [N]: the sum of the harmonics' amplitudes."""
    return float(_amplitudes(parameters).sum())


def cogging_slope(parameters: AxisParameters) -> float:
    """Bound of |dF_c / dx_m| [N/m]."""
    amplitudes = _amplitudes(parameters)
    order = np.arange(1, amplitudes.size + 1)
    return float(2 * np.pi / parameters.pole_pitch[0] * np.sum(order * amplitudes))


def _amplitudes(parameters: AxisParameters) -> np.ndarray:
    return np.hypot(np.asarray(parameters.cogging_sine), np.asarray(parameters.cogging_cosine))[0]
