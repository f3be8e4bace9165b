"""Stick and slip of the gantry's three sliders against a program with events."""

from itertools import product
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jcontour.plants.gantry.friction_gantry import StickSlipGantry

DT, SUBSTEPS, STEPS = 1e-3, 20, 100  # the same in most tests: compiled once


class ByEvents:
    """The same machine in (q, q') as a program with events.

    Lagrange multipliers hold the sliders that stick. An adaptive integrator stops where modes
    change.
    """

    def __init__(self, p, friction):
        self.span = float(p.half_span)
        self.coulomb = np.asarray(friction.coulomb)
        self.stribeck = np.asarray(friction.stribeck)
        self.speed = np.asarray(friction.stribeck_speed)
        self.viscous = np.asarray(friction.viscous)
        self.p = SimpleNamespace(**{name: float(value) for name, value in vars(p).items()})

    def rows(self, q, v):
        """J, and J' q'."""
        across = self.span * np.cos(q[2])
        turn = self.span * np.sin(q[2]) * v[2] ** 2
        return np.array([[1, 0, 0], [0, 1, -across], [0, 1, across]]), np.array([0, turn, -turn])

    def terms(self, q, v, u):
        """M and Q - h, (5.4)-(5.9)."""
        p, (x, _, theta), (dx, dy, omega) = self.p, q, v
        M_e, d, L, sine, cosine = (
            p.head_mass,
            p.tool_offset,
            p.half_span,
            np.sin(theta),
            np.cos(theta),
        )
        masses, imbalance = (
            M_e + p.drive_mass_1 + p.drive_mass_2 + p.beam_mass,
            L * (p.drive_mass_1 - p.drive_mass_2),
        )
        inertia = (
            L**2 * (p.drive_mass_1 + p.drive_mass_2)
            + p.beam_mass * (L**2 + p.half_width**2) / 3
            + M_e * (d**2 + x**2)
        )
        yaw = M_e * d * sine + (M_e * x - imbalance) * cosine
        mass = np.array(
            [[M_e, M_e * sine, M_e * d], [M_e * sine, masses, yaw], [M_e * d, yaw, inertia]]
        )
        lift = L * cosine * omega
        pushes = p.drive_constant * u[1:] - p.drive_viscous * np.array([dy - lift, dy + lift])
        springs = (
            2 * p.joint_stiffness * theta + 2 * p.lateral_stiffness * L**2 * (1 - cosine) * sine
        )
        across = (
            M_e * (2 * dx * omega * cosine + omega**2 * (d * cosine - x * sine))
            + imbalance * omega**2 * sine
        )
        return mass, np.array(
            [
                p.head_constant * u[0] - p.head_viscous * dx + M_e * x * omega**2,
                pushes.sum() - across,
                L * cosine * (pushes[1] - pushes[0]) - 2 * M_e * omega * dx * x - springs,
            ]
        )

    def accelerations(self, x, u, mode):
        """q'', and what every guide way that holds its slider exerts."""
        q, v = x[:3], x[3:]
        mass, force = self.terms(q, v, u)
        J, turning = self.rows(q, v)
        speed = J @ v
        push = (
            -mode * (self.coulomb + self.stribeck / (1 + (speed / self.speed) ** 2))
            - self.viscous * speed
        )
        stuck = mode == 0
        held = J[stuck]
        system = np.block([[mass, -held.T], [held, np.zeros((len(held), len(held)))]])
        solution = np.linalg.solve(
            system, np.concatenate([force + J[~stuck].T @ push[~stuck], -turning[stuck]])
        )
        reaction = np.zeros(3)
        reaction[stuck] = solution[3:]
        return solution[:3], reaction

    def modes(self, x, u, mode):
        """The one choice for the sliders at rest that its accelerations and reactions confirm."""
        rest = np.flatnonzero(mode == 0)
        for choice in sorted(product((0, 1, -1), repeat=len(rest)), key=np.count_nonzero):
            tried = mode.copy()
            tried[rest] = choice
            acceleration, reaction = self.accelerations(x, u, tried)
            J, turning = self.rows(x[:3], x[3:])
            along = tried * (J @ acceleration + turning)
            if all(
                along[i] > 0 if tried[i] else abs(reaction[i]) <= self.coulomb[i] + self.stribeck[i]
                for i in rest
            ):
                return tried
        raise AssertionError("no choice agrees")

    def rates(self, time, x, u, mode):
        return np.concatenate([x[3:], self.accelerations(x, u, mode)[0]])

    def sample(self, x, mode, u, duration):
        """State and modes after currents that are held."""
        time = 0.0
        mode = self.modes(x, u, mode)
        while time < duration:
            run = solve_ivp(
                self.rates,
                (time, duration),
                x,
                method="DOP853",
                rtol=1e-10,
                atol=1e-13,
                max_step=1e-4,
                args=(u, mode),
                events=[_Change(self, i, mode[i]) for i in range(3)],
            )
            time, x = run.t[-1], run.y[:, -1]
            if run.status == 1:
                fired = next(i for i in range(3) if len(run.t_events[i]))
                if mode[fired]:
                    mode[fired] = 0
                    x = self.stopped(x, mode)
                    mode = self.modes(x, u, mode)
                else:
                    mode[fired] = -np.sign(self.accelerations(x, u, mode)[1][fired])
        return x, mode

    def stopped(self, x, mode):
        """Sliders that stick have no speed at all."""
        J, _ = self.rows(x[:3], x[3:])
        speed = np.where(mode == 0, 0, J @ x[3:])
        return np.concatenate([x[:3], np.linalg.solve(J, speed)])


class _Change:
    """Speed of a slider that slips, or what is on one that sticks beyond what holds it."""

    terminal = True

    def __init__(self, program, i, mode):
        self.program, self.i, self.direction = program, i, -1 if mode else 1

    def __call__(self, time, x, u, mode):
        program, i = self.program, self.i
        if mode[i]:
            return mode[i] * (program.rows(x[:3], x[3:])[0] @ x[3:])[i]
        return (
            abs(program.accelerations(x, u, mode)[1][i]) - program.coulomb[i] - program.stribeck[i]
        )


def test_it_is_the_machine_of_a_program_with_events(odd_gantry, rubbing, swinging, run, at_rest):
    """Forty milliseconds in which all three stick, break loose and turn.

    The instants are found to a substep.
    """
    currents, program = swinging(STEPS, seed=1, size=0.6), ByEvents(odd_gantry, rubbing)
    plant = StickSlipGantry(odd_gantry, rubbing, DT, SUBSTEPS)
    x, mode, wanted, modes = np.asarray(plant.measure(at_rest(plant))), np.zeros(3, int), [], []
    for control in currents[:40]:
        x, mode = program.sample(x, mode.copy(), control, DT)
        wanted.append(x)
        modes.append(mode)
    assert (
        all(set(row) >= {0, 1} for row in np.array(modes)[:, 1:].T)
        and (np.array(modes) == -1).any()
    )
    found, states = run(plant, at_rest(plant), currents)
    np.testing.assert_array_equal(states.mode[:40], modes)
    np.testing.assert_allclose(
        found[:40, :3], np.array(wanted)[:, :3], rtol=0, atol=2e-8
    )  # of 1e-4 m
    np.testing.assert_allclose(
        found[:40, 3:], np.array(wanted)[:, 3:], rtol=0, atol=2e-6
    )  # of 1e-2 m/s


@pytest.mark.parametrize("machine", ["reference_gantry", "odd_gantry"])
def test_sliders_break_loose_as_only_they_can(machine, request, rubbing, at_rest):
    """Breaking loose one after another finds what trying all choices finds.

    Only one choice for the sliders at rest agrees with the equation of motion.
    """
    p, random, choices = request.getfixturevalue(machine), np.random.default_rng(5), set()
    plant, program = StickSlipGantry(p, rubbing, 1e-7, substeps=1), ByEvents(p, rubbing)
    step = eqx.filter_jit(plant.step)
    for _ in range(200):
        start = at_rest(plant, (random.uniform(-0.5, 0.5), 0.0))
        speed, twist = (
            random.uniform(-0.1, 0.1, 3) * random.integers(0, 2, 3),
            random.uniform(-4e-6, 4e-6),
        )
        sliders = start.sliders.at[3:].set(speed).at[1].add(-twist).at[2].add(twist)
        state = start._replace(sliders=sliders, mode=jnp.sign(speed).astype(start.mode.dtype))
        control = random.uniform(-1.5, 1.5, 3)
        wanted = program.modes(
            np.asarray(plant.measure(state)), control, np.sign(speed).astype(int)
        )
        np.testing.assert_array_equal(step(state, jnp.asarray(control)).mode, wanted)
        choices.add(tuple(wanted))
    assert len(choices) > 20
