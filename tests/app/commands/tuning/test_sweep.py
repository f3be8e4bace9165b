"""`sweep`: a small one from the command line."""

import numpy as np
import pytest
import xarray as xr

from jcontour.app.cli import main
from jcontour.app.files.results.search_results import SweepResult
from jcontour.app.files.results.stored import read_result

NAMES = ("alpha", "beta")


@pytest.fixture
def swept(tour):
    """Four designs with one preview; the large alpha diverges where a drive is late."""
    return tour("sweep").folder


@pytest.fixture
def dataset(swept):
    return xr.load_dataset(swept / "sweep.nc")


def test_every_file_is_there(swept):
    found = {path.name for path in swept.iterdir()}
    assert found == {"settings.json", "inputs", "parts", "sweep.nc", "sweep.png", "result.json"}


def test_designs_are_the_grid(dataset):
    places = list(zip(dataset.alpha.values, dataset.beta.values, strict=True))
    assert places == [(2, 0.5), (2, 5), (2e6, 0.5), (2e6, 5)]
    assert dataset.rms_contour_error.dims == ("preview", "sample", "contour", "plant")
    assert dataset.rms_contour_error.attrs["units"] == "m" and dataset.plant.values[0] == "nominal"


def test_weights_that_do_not_vary_and_the_delay_of_the_model_are_stored(dataset):
    assert dataset.attrs["controller"] == "contouring-lq-kalman"
    assert dataset.attrs["model_delay"] in (0, 1) and dataset.attrs["terminal"] == "output"
    assert dataset.control_noise.values.tolist() == [5.0] and dataset.rho.values.tolist() == [2e-9]
    assert dataset.rho.dims == ("preview",) and "per sample" in dataset.rms_increment.units


def test_the_summary_is_that_of_the_metrics(swept, dataset):
    result = read_result(swept, SweepResult)
    lost = dataset.diverged.values.astype(bool).any(axis=(2, 3))[0]
    assert lost.tolist() == [False, False, True, True]
    assert (result.points, result.diverged) == (4, 2)
    (best,) = result.best
    errors = 1e6 * dataset.rms_contour_error.values[0]
    worst = np.where(lost, np.inf, errors.max(axis=(1, 2)))
    alike = [k for k in range(4) if worst[k] <= 1.01 * worst.min()]
    i = min(alike, key=lambda k: float(dataset.rms_increment.values[0, k].max()))
    assert best.preview == 4
    assert best.weights == {name: float(dataset[name][i]) for name in NAMES}
    assert best.worst_um == errors[i].max() and best.nominal_um == errors[i, :, 0].max()


def test_margins_of_every_design_are_stored(swept, dataset):
    """Those of the best design are those of the table."""
    (best,) = read_result(swept, SweepResult).best
    row = dataset.isel(preview=0, sample=int(dataset.best[0]))
    assert float(row.peak_sensitivity.max()) == pytest.approx(best.sensitivity, rel=1e-9)
    assert float(row.delay_margin.sel(plant="nominal").min()) == best.delay_samples
    assert (dataset.peak_sensitivity.units, dataset.delay_margin.units) == ("1", "samples")
    unstable = ~np.isfinite(dataset.peak_sensitivity.values)
    np.testing.assert_array_equal(unstable, dataset.delay_margin.values == -1)
    assert not np.isnan(dataset.peak_sensitivity.values).any()
    assert unstable.any() and not unstable.all()


def test_a_finished_sweep_says_what_it_drew_what_diverged_and_what_is_next(swept, capsys):
    assert main(["sweep", "--resume", str(swept), "--details"]) == 0
    printed = capsys.readouterr().out
    assert "4 points, 2 diverged, 2 within the limits" in printed
    assert "Diverged: preview 4, alpha 2e+06, beta 0.5\n" in printed
    assert "Drawn: sweep.png" in printed
    assert "Next     jcontour tune " in printed and str(swept) in printed


def test_a_limit_that_a_sweep_does_not_look_at_is_no_flag_of_it(capsys):
    with pytest.raises(SystemExit):
        main(["sweep", "circle", "--max-effort", "1.2"])
    assert "--max-effort" in capsys.readouterr().err
