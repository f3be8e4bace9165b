import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete, ss2tf

from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry
from jcontour.plants.gantry.linear_models import (
    X,
    Y,
    control_oriented,
    drive_response,
    tangent,
    tool_plant,
)
from jcontour.plants.gantry.parameters import thesis_gantry

DT = 2e-3


def test_reference_models(gantry_data, reference_gantry):
    """Continuous and sampled, both parts; inputs and disturbances each in their columns."""
    for head, wanted in gantry_data("linear")["linear"].items():
        axis = X if head == "x_axis" else Y
        columns = (0,) if head == "x_axis" else (1, 2)
        model = control_oriented(reference_gantry, 0.3 if head == "x_axis" else float(head))
        for one, names in ((model, "ABE"), (model.sampled(DT), ("Ad", "Bd", "Ed"))):
            A, B, E = (np.asarray(matrix) for matrix in one)
            for found, name in (
                (A[np.ix_(axis, axis)], names[0]),
                (B[np.ix_(axis, columns)], names[1]),
                (E[np.ix_(axis, columns)], names[2]),
            ):
                scale = np.abs(wanted[name]).max()
                np.testing.assert_allclose(found, wanted[name], rtol=1e-10, atol=1e-13 * scale)


def test_reference_resonances(gantry_data, reference_gantry):
    for head, wanted in gantry_data("linear")["linear"].items():
        if head == "x_axis":
            continue
        for name, coupling in (
            ("as_printed_5.12", 0.0),
            ("full", reference_gantry.head_mass * float(head)),
        ):
            numerator, denominator = (
                np.roots(row) for row in drive_response(reference_gantry, float(head), coupling)
            )
            swinging = denominator[np.abs(denominator.imag) > 0]
            np.testing.assert_allclose(
                np.abs(numerator) / (2 * np.pi),
                wanted["i1_to_y1dot"][name]["antires_Hz"],
                rtol=1e-12,
            )
            np.testing.assert_allclose(
                np.abs(swinging) / (2 * np.pi), wanted["i1_to_y1dot"][name]["res_Hz"], rtol=1e-12
            )


def test_the_response_is_that_of_the_model(odd_gantry):
    """(5.12) with coupling and unequal drives against SciPy's transfer function."""
    head, coupling = 0.3, 17.0 * 0.3 - (13.0 - 31.0) * 0.6
    A, B, _ = (np.asarray(matrix) for matrix in control_oriented(odd_gantry, head))
    speed = [[0, 1, 0, -0.6]]
    numerator, denominator = ss2tf(A[np.ix_(Y, Y)], B[np.ix_(Y, (1,))], speed, [[0.0]])
    s = 2j * np.pi * np.array([1.0, 10.0, 40.0, 90.0])
    ours = np.polyval(drive_response(odd_gantry, head, coupling)[0], s) / np.polyval(
        drive_response(odd_gantry, head, coupling)[1], s
    )
    np.testing.assert_allclose(
        ours, np.polyval(numerator[0], s) / np.polyval(denominator, s), rtol=1e-9
    )


def test_the_tangent_is_the_derivative_of_the_equation_of_motion(odd_gantry):
    motion, head = EquationOfMotion.of(odd_gantry), 0.25

    def rates(state, control):
        return jnp.concatenate(
            [state[3:], jnp.stack(motion.acceleration(state[:3], state[3:], control))]
        )

    A, B = jax.jacfwd(rates, argnums=(0, 1))(jnp.array([head, 0.1, 0, 0, 0, 0]), jnp.zeros(3))
    found = tangent(odd_gantry, head)
    np.testing.assert_allclose(found.A, A, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(found.B, B, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        found.E[3:], np.linalg.inv(motion.mass_matrix(jnp.array([head, 0, 0]))), rtol=1e-12
    )


def test_the_tangent_plant_follows_the_gantry_for_small_motions():
    p, head = thesis_gantry(), 0.4
    plant, model = Gantry(p, DT, substeps=40), tool_plant(p, head, DT)
    A, B, _, _, _ = cont2discrete(
        (*(np.asarray(m) for m in tangent(p, head)[:2]), np.eye(6), np.zeros((6, 3))), DT
    )
    np.testing.assert_allclose(model.A, A, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(model.B, B, rtol=1e-9, atol=1e-15)
    off, control = 1e-6 * np.array([1.0, 2, 0.1, 3, -2, 1]), 1e-4 * np.array([1.0, -2, 3])
    state = np.asarray(plant.initial_state(np.array([head, 0.0]), np.zeros(2)))
    tool = jax.jit(lambda x, u: plant.output(plant.step(x, u)))(state + off, control)
    off[0] += head
    moved = jax.jit(lambda x, u: model.output(model.step(x, u)))(off, control)
    np.testing.assert_allclose(tool, moved, rtol=0, atol=1e-11)


def test_a_head_beyond_the_beam_is_named():
    wanted = r"^head: the head runs from -0.9 to 0.9 m along the beam, received 1 m"
    with pytest.raises(ValueError, match=wanted):
        control_oriented(thesis_gantry(), 1.0)
    with pytest.raises(ValueError, match="^dt:"):
        tool_plant(thesis_gantry(), 0.0, -1.0)
