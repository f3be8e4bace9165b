"""Contouring in polar coordinates."""

import numpy as np
import pytest

from jcontour.controllers.contouring.schemes import Polar
from jcontour.geometry.contours import spline
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import simulate


def first(tree):
    import jax

    return jax.tree.map(lambda leaf: leaf[0], tree)


def test_without_gains_it_is_the_cascade(table):
    path = table.on_circle(steps=100)
    polar = simulate(table.plant, Polar(table.cascade(), 0.0), path)
    plain = simulate(table.plant, table.cascade(), path)
    np.testing.assert_allclose(polar.output, plain.output, rtol=0, atol=1e-12)


def test_on_a_circle_the_radial_error_is_the_contour_error(table):
    """However far behind the tool is, a speed of k eps along its own radius corrects it."""
    path, cascade = table.on_circle(steps=100), table.cascade()
    polar, plain = first(Polar(cascade, 7.0).prepare(path)), first(cascade.prepare(path))
    law = Polar(cascade, 7.0)
    angle, radius = 1.2, 0.9 * table.radius
    centre = np.asarray(polar.centre)
    place = centre + radius * np.array([np.cos(angle), np.sin(angle)])
    measured = np.zeros(8)
    measured[[2, 6]] = place / 0.7958e-3
    memory = law.initial_memory(path)
    _, with_polar = law.step(memory, polar, measured)
    _, without = cascade.step(memory.cascade, plain, measured)
    gains, dt = cascade.gains, cascade.dt
    speed = 7.0 * (table.radius - radius) * (place - centre) / radius
    wanted = np.asarray(without) + 10.0 * (1 + dt / 0.05) * speed
    assert np.asarray(gains.velocity) == 10.0
    np.testing.assert_allclose(with_polar, wanted, rtol=1e-8)


def test_a_circle_has_no_contour_error_with_an_integral(table):
    path = table.on_circle()
    run = simulate(table.plant, Polar(table.cascade((25.0, 25.0)), 20.0, 200.0), path)
    centre = np.asarray(Polar(table.cascade(), 1.0).prepare(path).centre)[0]
    off = np.linalg.norm(np.asarray(run.output)[-400:] - centre, axis=1) - table.radius
    plain = simulate(table.plant, table.cascade((25.0, 25.0)), path)
    other = np.linalg.norm(np.asarray(plain.output)[-400:] - centre, axis=1) - table.radius
    assert np.abs(off).mean() < 0.2 * np.abs(other).mean()


def test_a_centre_on_the_curve_is_refused(table):
    wave = spline(np.array([[0.0, 0.0], [1e-3, 1e-3], [2e-3, 0.0], [3e-3, 1e-3]]))
    path = along(wave, 1e-5 * np.arange(50), table.dt, 1, at_rest=False)
    with pytest.raises(ValueError, match="is on the curve"):
        Polar(table.cascade(), 1.0, centre=np.asarray(path.position)[7]).prepare(path)
