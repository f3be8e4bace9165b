import jax.numpy as jnp
import numpy as np
import pytest

from experiments.yuan_gantry_claims import PRINTED_HZ, claims
from experiments.yuan_gantry_figures import draw
from experiments.yuan_gantry_runs import SAMPLE, along_the_path, reference_path, responses
from jcontour.plants.gantry_parameters import thesis_gantry


@pytest.fixture(scope="module")
def summary():
    engines = [{"engine": "jcontour", "difference": 0.0, "single": 1.0, "batched": 1.0}]
    return {"responses": responses(), "path": along_the_path(), "engines": engines}


def test_frequencies_of_the_reference_data(summary):
    """Printed: 47 and 45 Hz; with the coupling 51.19 and 40.62 Hz, by another program (reference data, `linear`)."""
    found = {(row["head_m"], row["coupling"]): row["antiresonance_hz"] for row in summary["responses"]}
    wanted = {(0.0, False): 47.0, (-0.66, False): 45.0, (0.66, False): 45.0, (-0.66, True): 51.19, (0.66, True): 40.62}
    assert found.keys() == wanted.keys()
    for case, frequency in wanted.items():
        assert found[case] == pytest.approx(frequency, abs=0.01)


def test_the_least_gain_is_at_the_antiresonance(summary):
    for row in summary["responses"]:
        near = (row["frequency_hz"] > 30) & (row["frequency_hz"] < 60)
        assert row["frequency_hz"][near][np.argmin(row["gain_db"][near])] == pytest.approx(row["antiresonance_hz"], rel=5e-3)


def test_the_path_is_that_of_the_thesis():
    """Length 2 x 80 mm and a circle of 80 mm; 0.1 m/s reached at 1 m/s^2: 6.7265 s (reference data, `path`)."""
    reference = reference_path()
    position = np.asarray(reference.position)
    speed = np.linalg.norm(np.diff(position, axis=0), axis=1) / SAMPLE
    assert (reference.steps - 1) * SAMPLE == pytest.approx(6.726548, abs=SAMPLE)
    np.testing.assert_allclose(position[[0, -1]], [[0.08, -0.08], [0.08, 0.08]], atol=1e-12)
    assert speed.max() == pytest.approx(0.1, rel=1e-3) and np.abs(np.diff(speed)).max() / SAMPLE < 1.001
    round_it = np.abs(np.linalg.norm(position, axis=1) - 0.08) < 1e-9
    assert round_it.sum() * SAMPLE * 0.1 == pytest.approx(2 * np.pi * 0.08, rel=0.01)


def test_the_twist_is_what_turns_the_head_along_the_beam(summary):
    """At steady speed the springs bear little but M_e d x_h'' and M_e x_h y'', eq. 5.9: 2 k_r theta is about their sum."""
    p, path = thesis_gantry(), summary["path"]
    moving = (path["time_s"] > 2.0) & (path["time_s"] < 5.0)
    position = np.asarray(path["tool_m"])
    acceleration = np.gradient(np.gradient(position, SAMPLE, axis=0), SAMPLE, axis=0)
    moment = -p.head_mass * (p.tool_offset * acceleration[:, 0] + position[:, 0] * acceleration[:, 1])
    wanted = np.asarray(moment / (2 * p.joint_stiffness))[moving]
    twist = np.asarray(path["twist_rad"])[moving]
    assert np.abs(twist - wanted).max() < 0.1 * np.abs(wanted).max()
    assert not path["diverged"] and jnp.isfinite(path["control_a"]).all()


def test_verdicts_follow_the_numbers(summary):
    verdicts = [claim["verdict"] for claim in claims(summary)]
    assert verdicts == ["reproduced", "not reproduced", "reproduced", "experimental: shown, not matched", "reproduced"]
    twisted = {**summary, "path": {**summary["path"], "peak_twist_rad": 1e-3}, "engines": [{**summary["engines"][0], "difference": 1e-3}]}
    assert [claim["verdict"] for claim in claims(twisted)][2::2] == ["not reproduced", "not reproduced"]
    shifted = [{**row, "antiresonance_hz": PRINTED_HZ[-0.66]} for row in summary["responses"]]
    assert [claim["verdict"] for claim in claims({**summary, "responses": shifted})][:2] == ["not reproduced", "reproduced"]


def test_figures(summary, tmp_path):
    for path in draw(summary, tmp_path):
        assert path.stat().st_size > 20_000
