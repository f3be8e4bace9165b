"""What the figure of a certificate shows."""

import numpy as np

from jcontour.app.reports.figures.loops.certificate import CertifiedErrors, certificate_figure


def test_three_curves_in_um_where_samples_count():
    errors = CertifiedErrors(
        name="circle, late",
        error="contour",
        time=np.array([0.0, 0.1, 0.2]),
        bound=np.array([3e-6, 4e-6, 5e-6]),
        reached=np.array([1e-6, 2e-6, 4.9e-6]),
        nominal=np.array([1e-7, 1e-7, 2e-7]),
        scored=np.array([False, True, True]),
    )
    (axes,) = certificate_figure(errors).axes
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    np.testing.assert_allclose(lines["bound, proven"], [np.nan, 4.0, 5.0])
    np.testing.assert_allclose(lines["reached under attack"], [np.nan, 2.0, 4.9])
    np.testing.assert_allclose(lines["undisturbed"], [np.nan, 0.1, 0.2])
    assert axes.get_ylabel() == "contour error [um]" and axes.get_ylim()[0] == 0.0
