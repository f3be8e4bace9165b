import numpy as np
import pytest

from jcontour.app.files.checks import MachineError
from jcontour.app.jobs import excitation
from jcontour.app.jobs.excitation import PART, SHARE, gcode, letters, program, read_limits

GIVEN = {"travel": [400, 300], "speed": 250, "acceleration": [2000, 1500]}
PATH = "limits.json"
SAME = {"travel": 400, "acceleration": 2000}  # for any number of axes


@pytest.fixture(scope="module")
def limits():
    return read_limits(PATH, GIVEN)


def test_speed_and_acceleration_stay_within_their_share(limits):
    positions = program(limits)
    speed = np.diff(positions, axis=0) / limits.dt
    acceleration = np.diff(speed, axis=0) / limits.dt
    assert (np.abs(positions).max(axis=0) <= 1.001 * PART * limits.travel).all()
    assert (np.abs(speed).max(axis=0) <= 1.01 * SHARE * limits.speed).all()
    assert (np.abs(acceleration).max(axis=0) <= 1.01 * SHARE * limits.acceleration).all()
    assert (np.abs(acceleration).max(axis=0) > 0.9 * SHARE * limits.acceleration).all()
    assert not positions[[0, -1]].any()


@pytest.mark.parametrize("change", [{}, {"travel": 2000, "speed": 500}, {"acceleration": 500}])
@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("dt", [2.5e-4, 0.01, 0.05])
def test_any_clock_gets_multisines_within_the_limits(dt, axes, change):
    limits = read_limits(PATH, GIVEN | {"dt": dt, "axes": list("XYZ")[:axes], **SAME} | change)
    speed = np.diff(program(limits), axis=0) / dt
    assert (np.abs(speed).max(axis=0) <= 1.01 * SHARE * limits.speed).all()
    bent = np.diff(program(limits), 2, axis=0) / dt**2
    assert (np.abs(bent).max(axis=0) <= 1.01 * SHARE * limits.acceleration).all()
    assert (np.abs(bent).max(axis=0) > 0.3 * SHARE * limits.acceleration).all()


def test_realisations_at_every_level_repeat_and_share_no_line(limits):
    """Of each section the last periods repeat, but for the slow move; lines of axes are apart."""
    rows = round(excitation.PERIOD / limits.dt)
    section = (1 + excitation.KEPT) * rows
    first = round(section / 2 / excitation.FASTER) + round(excitation.EASE / 2 / limits.dt)
    spectra = []
    for k in range(excitation.REALISATIONS * len(excitation.LEVELS)):
        end = first + (k + 1) * section
        part = np.diff(program(limits)[end - 2 * rows : end + 1], axis=0)
        one, two = part[:rows], part[rows:]
        assert np.abs(one - two)[: rows // 2].max() < 1e-6 * np.abs(one).max()
        assert np.all(np.abs(np.mean(one, axis=0)) > np.abs(one - np.mean(one, axis=0)).max(axis=0))
        spectra.append(np.fft.rfft(one, axis=0)[1:])
    first = np.abs(spectra[0])
    lines = first > 1e-4 * first.max(axis=0)
    assert lines.any(axis=0).all() and not (lines[:, 0] & lines[:, 1]).any()
    hertz = np.fft.rfftfreq(rows, limits.dt)[1:]
    assert hertz[lines.any(axis=1)].max() == pytest.approx(excitation.HIGHEST, rel=0.05)
    for k, one in enumerate(spectra):
        level = excitation.LEVELS[k // excitation.REALISATIONS]
        for x in range(2):
            share = one[lines[:, x], x] / spectra[0][lines[:, x], x]
            np.testing.assert_allclose(np.abs(share), np.abs(share).mean(), rtol=1e-3)
            assert np.abs(share).mean() == pytest.approx(level, rel=0.1)  # peaks differ
            assert k == 0 or np.abs(share.mean()) < 0.5 * level  # phases of its own


def test_the_program_ends_where_it_began_and_stays_within_the_travel(limits):
    place, visited, slowest = np.zeros(2), [], np.inf
    for line in gcode(limits).splitlines():
        if not line.startswith("G1"):
            continue
        words = {word[0]: float(word[1:]) for word in line.split()[1:]}
        place = place + [words.get("X", 0.0), words.get("Y", 0.0)]
        visited.append(place)
        slowest = min(slowest, words["F"])
    assert np.abs(place).max() < 1e-6
    assert (np.abs(visited).max(axis=0) <= 1e3 * PART * limits.travel + 1e-6).all()
    assert slowest / 60e3 == pytest.approx(SHARE * limits.speed.min())


@pytest.mark.parametrize(
    ("names", "moved"),
    [
        (["Y", "x"], ("Y", "X")),
        (["U", "C"], ("U", "C")),
        (["left drive", "X2"], ("X", "Y")),
        (["F", "M"], ("X", "Y")),
        (["x", "X"], ("X", "Y")),
    ],
)
def test_every_move_is_a_word_that_moves_an_axis(names, moved):
    limits = read_limits(PATH, GIVEN | {"axes": names})
    assert letters(limits) == moved
    program = gcode(limits).splitlines()
    used = {word[0] for line in program if line.startswith("G1") for word in line.split()[1:-1]}
    assert used == set(moved)
    assert {f"; {name} alone" for name in names} <= set(program)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"travel": None}, "limits.json: travel: missing"),
        ({"speed": -1}, "speed"),
        ({"axes": ["X"]}, "axes: needs to have at least 2 items"),
        ({"axes": 5}, "axes: needs to be a valid list"),
        ({"axes": ["X", "X"]}, "axes"),
        ({"length_unit": ["mm"]}, "length_unit: needs to be 'm', 'mm' or 'um'"),
        ({"length_unit": "inch"}, "length_unit: needs to be 'm', 'mm' or 'um'"),
        ({"jerk": 3}, "there is no field 'jerk'"),
        ({"dt": 0.06}, "dt: needs to be less than or equal to 0.05, received 0.06"),
    ],
)
def test_limits_that_cannot_be_used(change, words):
    fields = {key: value for key, value in (GIVEN | change).items() if value is not None}
    with pytest.raises(MachineError, match=words):
        read_limits(PATH, fields)
