import jax
import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.mpc.contouring.contouring_qp import path_of

PATHS = {
    "lobes": polar_lobes(30e-3, 10e-3, 4),
    "square": contours.polygon([[0.0, 0.0], [0.03, 0.0], [0.03, 0.03], [0.0, 0.03]]),
    "rounded": contours.chain(
        [contours.line([0.0, 0.0], [0.02, 0.0]), contours.arc([0.02, 0.0], [0.02, 0.01], np.pi)]
    ),
    "helix": contours.arc([0.02, 0.0, 0.0], [0.0, 0.0, 0.0], 7.0, rise=0.01),
    "lemniscate": contours.lemniscate(0.03),
}


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("unit", (1.0, 1e-3))
def test_is_the_contour_in_another_unit(name, unit):
    contour = PATHS[name]
    path = path_of(contour, unit)
    assert (
        path.length * unit == pytest.approx(float(contour.length), rel=1e-14)
        and path.axes == contour.axes
    )
    for arc in np.linspace(0.0, path.length, 101):
        position, slope = path.at(arc)
        inside = min(
            arc * unit, np.nextafter(float(contour.length), 0)
        )  # the end itself wraps on a closed contour
        np.testing.assert_allclose(position * unit, contour.position(inside), rtol=0, atol=1e-13)
        if np.abs(np.asarray(contour.start) - inside).min() > 1e-9:
            np.testing.assert_allclose(
                slope / np.linalg.norm(slope), contour.tangent(inside), rtol=0, atol=1e-9
            )


def test_slope_is_the_derivative():
    path = path_of(PATHS["rounded"], 1e-3)
    for arc in (3.3, 25.0, 40.0):
        forward, backward = path.at(arc + 1e-4)[0], path.at(arc - 1e-4)[0]
        np.testing.assert_allclose(path.at(arc)[1], (forward - backward) / 2e-4, rtol=0, atol=1e-8)


def test_padding_does_not_count():
    padded = contours.stack([PATHS["square"], PATHS["rounded"]])
    alone = jax.tree.map(lambda rows: np.asarray(rows)[1], padded)
    assert path_of(alone, 1.0).rate.size == 2


@pytest.mark.parametrize(
    "contour, unit, words", [("square", 0.0, "length_unit"), ("square", np.nan, "length_unit")]
)
def test_bad_input_is_one_line(contour, unit, words):
    with pytest.raises(ValueError, match=words):
        path_of(PATHS[contour], unit)
