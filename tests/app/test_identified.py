"""Commands on machine files as `identify` writes them: each axis with numbers of its own."""

import pytest

from jcontour.app.files.results.loop_results import CertifiedResult, ExportedResult
from jcontour.app.files.results.stored import versioned
from tests.app.conftest import PART
from tests.app.test_tour import RESULTS
from tests.app.tour import STOPS, Tour

LINES = {
    "hertz": [[2.0, 20.0, 50.0], [3.0, 30.0]],
    "real": [[0.01, -0.02, 0.05], [0.01, 0.03]],
    "imaginary": [[0.0, 0.02, -0.05], [0.01, -0.02]],
    "half_width": [[0.02, 0.03, 0.1], [0.03, 0.05]],
}
DOUBT = {"hertz": [1.0, 60.0, 249.0], "relative": [[0.03, 0.2, 2.0], [0.05, 0.3, 4.0]]}
UNCERTAINTY = {"gain": 0.02, "response": DOUBT, "measured": LINES}
BOTH = {
    "length_unit": "mm",
    "dt": 0.002,
    "C": [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    "known_delay": 1,
    "encoder_resolution": [1e-3, 5e-4],
    "encoder_noise": [3e-4, 1e-3],
    "friction_known_to": [0.1, 0.2],
    "uncertainty": UNCERTAINTY,
    "note": "the record holds 3 um that the command does not explain",
}
FORCE = {
    **BOTH,
    "control_unit": "A",
    "A": [[1, 0.0016, 0, 0], [0, 0.98, 0, 0], [0, 0, 1, 0.0016], [0, 0, 0, 0.97]],
    "B": [[0.02, 0], [20, 0], [0, 0.03], [0, 30]],
    "limits": {"speed": [200, 250], "acceleration": [4000, 5000], "control": [10, 8]},
    "uncertainty": {**UNCERTAINTY, "other_amplitudes": LINES},
    "friction": [0.1, 0.05],
    "stribeck_friction": [0.04, 0.0],
    "stribeck_speed": [5.0, 1000.0],
    "backlash": [2e-3, 0.0],
}
POSITION = {
    **BOTH,
    "control_unit": "mm",
    "A": [[0.7, 0.3, 0, 0], [0, 0.6, 0, 0], [0, 0, 0.75, 0.25], [0, 0, 0, 0.5]],
    "B": [[0, 0], [0.4, 0], [0, 0], [0, 0.5]],
    "limits": {"speed": [200, 250], "acceleration": [4000, 5000], "control": [400, 400]},
    "friction": [0.02, 0.01],
}
WITHOUT_IT = ("list", "new-machine", "traverse", "excite", "identify")  # commands, not of a machine
COMMANDS = [name for name in STOPS if name not in WITHOUT_IT]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:.*is not in what is promised:UserWarning"),
]
KINDS = {"force": FORCE, "position": POSITION}
GROUPS = [pytest.param(KINDS[name], id=name, marks=pytest.mark.xdist_group(name)) for name in KINDS]


@pytest.fixture(scope="module", params=GROUPS)
def tour(request, tmp_path_factory):
    return Tour(tmp_path_factory.mktemp("identified"), request.param, PART)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_ends_with_an_answer_that_is_read_again(tour, name):
    visit = tour(name)
    assert visit.code in (0, 3), visit.err
    if name in RESULTS:
        assert versioned(visit.result(RESULTS[name])) == visit.stored()


@pytest.mark.parametrize("name", ["check-bound", "check-bound-tuned"])
def test_no_attack_exceeds_the_bound(tour, name):
    rows = tour(name).result(CertifiedResult).rows
    assert len(rows) == 3
    assert all(row.nominal < row.reached <= row.bound for row in rows)


@pytest.mark.parametrize("name", ["export", "export-tuned"])
def test_the_exported_code_has_the_controls_of_the_run(tour, name):
    result = tour(name).result(ExportedResult)
    tolerance = 1e-10 if result.precision == "double" else 1e-4
    assert 0 <= result.difference < tolerance * result.largest_control
