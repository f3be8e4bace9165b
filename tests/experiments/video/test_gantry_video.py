"""A video of the gantry: speed, factors, poses, frames; and the answer where none can be made."""

import json
import os
import subprocess
import sys
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from experiments.catalogue.choices import job_named
from experiments.cli import main
from experiments.commands.loops.simulate import film_of
from experiments.jobs.job import Pace
from experiments.jobs.replays import Replay, Scenarios
from experiments.machines.gantry import gantry_machine
from experiments.video import gantry_video
from experiments.video.film import Film, VideoError, lines
from experiments.video.frames import (
    ERROR_SHOWN,
    LARGEST_FACTOR,
    SIZE,
    TWIST_SHOWN,
    Frames,
    error_factor,
    least_round,
    magnification,
    posed,
    twist_factor,
)
from experiments.video.gantry_video import FPS, LONGEST, SHORTEST, Playback, pose
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.parameters import thesis_gantry
from jcontour.plants.wrappers.delays import Delayed
from jcontour.plants.wrappers.saturation import Saturated


@pytest.fixture
def film():
    """A tool half a millimetre outside a ring, on a beam that twists by some microradians."""
    angle = np.linspace(0.0, 2 * np.pi, 401)
    out = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    twist = 3e-6 * np.sin(angle)
    state = np.stack([0.05 * out[:, 0], 0.05 * out[:, 1] + 0.2, twist], axis=-1)
    return Film(1e-3 * np.arange(401), state, 0.0505 * out, 5e-4 * out, 0.05 * out, "a ring")


@pytest.mark.parametrize(
    ("value", "found"),
    [(0.11, 0.2), (0.2, 0.2), (1.0, 1.0), (1.01, 2.0), (4.7, 5.0), (9.9, 10.0), (3e4, 5e4)],
)
def test_least_round(value, found):
    assert least_round(value) == pytest.approx(found, rel=1e-12)


@pytest.mark.parametrize("peak", [2.7e-6, 5.5e-6, 8e-6, 4e-7, 1.3e-3])
def test_factor_is_the_largest_round_one_that_fits(peak):
    factor = magnification(peak, TWIST_SHOWN)
    assert str(factor).rstrip("0") in ("1", "2", "5")
    assert peak * factor <= TWIST_SHOWN * (1 + 1e-9) < 2.5 * peak * factor * (1 + 1e-9)


def test_factor_has_ends():
    assert magnification(0.0, TWIST_SHOWN) == magnification(1e-12, TWIST_SHOWN) == LARGEST_FACTOR
    assert magnification(1.0, TWIST_SHOWN) == 1


@pytest.mark.parametrize(
    ("duration", "speed", "words"),
    [
        (1.047, 1 / 5, "slowed 5 x"),
        (0.03, 1 / 200, "slowed 200 x"),
        (5.0, 1, "real time"),
        (14.0, 1, "real time"),
        (60.0, 5, "sped up 5 x"),
    ],
)
def test_pace(duration, speed, words):
    time = 3.0 + 1e-3 * np.arange(round(1000 * duration) + 1)
    pace = Playback.of(time)
    assert pace.speed == pytest.approx(speed) and pace.words == words
    assert SHORTEST * 0.99 <= len(pace.samples) / FPS <= LONGEST + 1
    np.testing.assert_allclose(
        time[pace.samples] - time[0],
        np.arange(len(pace.samples)) * speed / FPS,
        rtol=0,
        atol=0.51e-3,
    )
    assert pace.samples[0] == 0 and pace.samples[-1] < len(time)


@pytest.mark.parametrize("twist", [-0.07, 0.0, 0.05])
def test_tool_stays_where_it_is(twist):
    parameters, tool = thesis_gantry(), np.array([-0.55, 0.03])
    found = posed(parameters, tool, twist)
    assert found[2] == twist
    np.testing.assert_allclose(parameters.tool(found), tool, rtol=0, atol=1e-15)


class _Recorded:
    """Keeps the poses that it is asked for."""

    def __init__(self):
        self.asked = []

    def picture(self, pose, straight):
        self.asked.append((pose, straight))
        return np.full((380, 960, 3), 200, np.uint8)


@pytest.mark.slow
def test_frames_show_the_factors_and_move_on(film):
    assert (
        twist_factor(film) == 20_000 and error_factor(film) == 10
    )  # 3 urad and 0.5 mm against 0.08 rad and 6 % of 100 mm
    assert error_factor(film) * 5e-4 <= ERROR_SHOWN * 0.1
    scene, parameters = _Recorded(), thesis_gantry()
    frames = Frames(scene, parameters, film, "slowed 10 x")
    first, later, again = (frames.pixels(sample) for sample in (0, 100, 0))
    assert first.shape == (*SIZE[::-1], 3) and first.dtype == np.uint8
    np.testing.assert_array_equal(first, again)  # nothing of a frame stays in the next
    assert (first != later).any()
    assert frames.title == "a ring    t = 0.000 s, slowed 10 x    twist x 20,000"
    turned, straight = scene.asked[1]
    assert turned[2] == pytest.approx(20_000 * film.pose[100, 2])
    np.testing.assert_allclose(parameters.tool(turned), film.tool[100], rtol=0, atol=1e-15)
    assert straight == pytest.approx(film.tool[100, 1] + 0.2)


def test_pose_is_that_of_the_gantry_inside():
    """Its tool is where the plant's output has it, with delay and limits around the machine."""
    parameters = thesis_gantry()
    plant = Delayed(Saturated(Gantry(parameters, 1e-3), np.full(3, 10.0)), 1, 2, 3)
    state = np.array([-0.5, 0.3, 2e-6, 0.1, 0.2, 1e-4]), np.zeros((2, 3))
    np.testing.assert_array_equal(pose(plant, state), [-0.5, 0.3, 2e-6])
    np.testing.assert_allclose(
        parameters.tool(pose(plant, state)), plant.output(state), rtol=0, atol=1e-15
    )


@pytest.mark.slow
def test_film_is_the_scored_part_of_the_stored_run():
    """The second lap of the nominal plant, in the run's own numbers."""
    machine = gantry_machine()
    job = job_named("ring-left", Pace(machine, None, None))
    scenarios = Scenarios.of([job], [False], machine, "outputs", 1)
    rows = np.arange(job.samples, dtype=float)
    signals = {
        name: k * 1e4 + rows[None, None, :, None]
        for k, name in enumerate(("watched", "output", "control", "contour_error"))
    }
    found = Replay(metrics=SimpleNamespace(diverged=np.array([[False, True]])), **signals)
    shown, first = film_of(scenarios, found, "x"), int(np.flatnonzero(job.scored)[0])
    assert (
        0 < first
        and shown.time[0] == pytest.approx(1e-3 * first)
        and len(shown.time) == job.samples - first
    )
    for k, seen in ((0, shown.pose), (1, shown.tool), (3, shown.error)):
        np.testing.assert_array_equal(seen[:, 0], k * 1e4 + rows[first:])
    np.testing.assert_allclose(
        np.linalg.norm(shown.path - [-0.55, 0.0], axis=1), 0.05, rtol=0, atol=1e-6
    )
    lost = found._replace(metrics=SimpleNamespace(diverged=np.array([[True, False]])))
    with pytest.raises(VideoError, match="nominal plant diverged"):
        film_of(scenarios, lost, "x")


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (
            AttributeError("no glGetError"),
            "OpenGL cannot be opened .MUJOCO_GL is osmesa: no glGetError.; install it .*libegl1",
        ),
        (
            ImportError("mujoco: needs version 4.0.0, found 3.1"),
            "video: mujoco: needs version 4.0.0",
        ),
    ],
)
def test_no_picture(monkeypatch, tmp_path, film, error, says):
    def fail(name):
        raise error

    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setattr(gantry_video, "import_module", fail)
    with pytest.raises(VideoError, match=says) as raised:
        gantry_video.record(thesis_gantry(), film, tmp_path)
    assert (
        "\n" not in str(raised.value)
        and os.environ["MUJOCO_GL"] == "osmesa"
        and not list(tmp_path.iterdir())
    )


@pytest.mark.slow
def test_gif_without_the_extra(monkeypatch, tmp_path, film):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    suffix, save = gantry_video._format()
    frames = Frames(_Recorded(), thesis_gantry(), film, "x")
    save(tmp_path / "video.gif", map(frames.pixels, (0, 100, 200)))
    with Image.open(tmp_path / "video.gif") as picture:
        assert (
            suffix == ".gif"
            and picture.format == "GIF"
            and picture.size == SIZE
            and picture.n_frames == 3
        )
        assert picture.info["duration"] == 1000 // FPS
    told = lines(
        {
            "file": "video.gif",
            "seconds": 5.0,
            "pace": "real time",
            "magnified": "twist x 2,000 (peak 30 urad)",
        },
        tmp_path,
    )
    assert "real time, twist x 2,000 (peak 30 urad)" in told[0] and "jcontour[video]" in told[1]


def test_only_of_a_gantry(capsys, tmp_path):
    assert main(["simulate", "--video", "--out", str(tmp_path / "run")]) == 2
    captured = capsys.readouterr()
    assert "needs a machine that can be drawn, as a gantry can; bridgeport cannot" in captured.err
    assert captured.err.count("\n") == 1 and not list(tmp_path.iterdir())


def _simulated(folder, gl):
    command = [
        sys.executable,
        "-m",
        "experiments.cli",
        "simulate",
        "--plant",
        "gantry",
        "--controller",
        "cascade",
    ]
    environment = {**os.environ, **({"MUJOCO_GL": gl} if gl else {})}
    return subprocess.run(
        [*command, "--video", "--json", "--out", str(folder)],
        capture_output=True,
        text=True,
        env=environment,
    )


@pytest.mark.slow
def test_a_real_video(tmp_path):
    done = _simulated(tmp_path / "run", None)
    if "OpenGL cannot be opened" in done.stderr:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    video = json.loads(done.stdout)["video"]
    assert video["file"] == "video.mp4" and (tmp_path / "run" / "video.mp4").stat().st_size < 2e6
    read = import_module("imageio_ffmpeg").count_frames_and_secs(
        str(tmp_path / "run" / "video.mp4")
    )
    assert (
        read[0] / FPS == pytest.approx(video["seconds"]) and SHORTEST * 0.99 < read[1] < LONGEST + 1
    )


@pytest.mark.slow
@pytest.mark.parametrize("gl", ["disable", "nonsense"])
def test_the_run_is_kept_where_nothing_can_be_drawn(tmp_path, gl):
    done = _simulated(tmp_path / "run", gl)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert f"MUJOCO_GL is {gl}" in done.stderr and "the rest of the run is in" in done.stderr
    assert {path.name for path in (tmp_path / "run").glob("*.*")} >= {
        "settings.json",
        "result.json",
        "rollouts.nc",
    }
    assert (
        "OpenGL" in json.loads((tmp_path / "run" / "result.json").read_text())["video"]["failure"]
    )
