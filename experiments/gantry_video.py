"""A video of the gantry along its contour, from a run that is already there: its pace, its file, and what stands in its way."""

import os
import platform
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float
from PIL import Image

from experiments import checks, runs
from experiments.gantry_frames import PICTURE, SIZE, Film, Frames, least_round
from experiments.replays import Course, Replay, desired, scored
from jcontour.plant import Plant, State
from jcontour.plants.gantry_parameters import GantryParameters
from jcontour.plants.wrappers import unwrapped

FPS = 25
SHORTEST, LONGEST = 5.0, 14.0  # [s] of the video
SEGMENTS = 240  # of the path on the table
QUALITY = 8  # of an MP4, of 10: lines stay sharp
COLOURS = 64  # of a GIF
MP4_NEEDS = "an MP4 needs `pip install 'jcontour[video]'`, or `uv run --extra video jcontour ...`"


class VideoError(ValueError):
    """There is no video; one line that says why and what helps."""


class Pace(NamedTuple):
    """Seconds of the run per second of the video, and the samples that are shown."""

    speed: float
    samples: np.ndarray

    @classmethod
    def of(cls, time: np.ndarray) -> "Pace":
        """Real time; the least round number of times slower, or faster, where the video would be too short, or too long."""
        duration = float(time[-1] - time[0])
        speed = 1 / least_round(SHORTEST / duration) if duration < SHORTEST else max(1.0, least_round(duration / LONGEST))
        shown = np.arange(int(duration / speed * FPS) + 1) * speed / FPS
        return cls(speed, np.rint(shown / duration * (len(time) - 1)).astype(int))

    @property
    def words(self) -> str:
        """For people."""
        if self.speed == 1:
            return "real time"
        return f"slowed {1 / self.speed:.4g} x" if self.speed < 1 else f"sped up {self.speed:.4g} x"


def pose(plant: Plant, state: State) -> Float[Array, "3"]:
    """(x_h, y_N, theta) of the gantry behind sensors, delays and limits: what a replay has to watch."""
    gantry, own = unwrapped(plant, state)
    return gantry.measure(own)[:3]


def film_of(course: Course, found: Replay, title: str) -> Film:
    """The first contour on the nominal plant, from its first scored sample to its last.

    Raises:
        VideoError: the run diverged.
    """
    if np.asarray(found.metrics.diverged)[0, 0]:
        raise VideoError(f"video: the run on the {course.plants[0]} plant diverged, there is nothing to show")
    first, last = np.flatnonzero(scored(course)[0])[[0, -1]]
    shown = slice(first, last + 1)
    time = course.references.dt * np.arange(first, last + 1)
    watched, tool, error = (np.asarray(rows)[0, 0, shown] for rows in (found.watched, found.output, found.contour_error))
    return Film(time, watched, tool, error, desired(course)[0, shown], title)


def record(parameters: GantryParameters, film: Film, folder: Path) -> dict[str, Any]:
    """Draw the film and write it into the folder: MP4 where the optional packages are, GIF elsewhere; its file, pace and factors.

    Raises:
        VideoError: there is no OpenGL, or another MuJoCo.
    """
    pace = Pace.of(film.time)
    path = film.path[np.linspace(0, len(film.path) - 1, SEGMENTS + 1).astype(int)]
    suffix, save = _format()
    with _scene(parameters, path) as scene:
        frames = Frames(scene, parameters, film, pace.words)
        file = runs.write(folder / f"video{suffix}", lambda temporary: save(temporary, map(frames.pixels, pace.samples)))
    return {
        "file": file.name, "pace": pace.words, "seconds": len(pace.samples) / FPS, "twist_factor": film.twist_factor,
        "error_factor": film.error_factor, "peak_twist_rad": float(np.abs(film.pose[:, 2]).max()),
    }  # fmt: skip


def lines(video: dict[str, Any], folder: Path) -> list[str]:
    """What a user is told of it."""
    drawn = f"twist x {video['twist_factor']:,} (peak {1e6 * video['peak_twist_rad']:.3g} urad), contour error x {video['error_factor']:,}"
    told = [f"Video: {folder / video['file']}, {video['seconds']:.3g} s, {video['pace']}, {drawn}"]
    return told + ([f"It is a GIF: {MP4_NEEDS}"] if video["file"].endswith(".gif") else [])


def _scene(parameters: GantryParameters, path: np.ndarray):
    """A `gantry_scene.Scene`: everything that imports the engine."""
    if platform.system() == "Linux":
        os.environ.setdefault("MUJOCO_GL", "egl")  # needs no display; the engine reads it when it is first imported
    try:
        import_module("jcontour.plants.gantry_mujoco")
    except ImportError as error:  # names the version that is needed
        raise VideoError(f"video: {checks.line(error)}") from None
    except Exception as error:  # every OpenGL, and what may be missing of it, raises another
        raise _no_opengl(error) from error
    try:
        return import_module("experiments.gantry_scene").Scene(parameters, path, PICTURE)
    except Exception as error:
        raise _no_opengl(error) from error


def _no_opengl(error: Exception) -> VideoError:
    how = os.environ.get("MUJOCO_GL") or "not set"
    helps = "install it (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri) or set MUJOCO_GL to another: egl, osmesa, glfw"
    return VideoError(f"video: OpenGL cannot be opened (MUJOCO_GL is {how}: {checks.line(error)}); {helps}")


def _format() -> tuple[str, Callable[[Path, Iterable[np.ndarray]], None]]:
    """Suffix of the file, and what writes frames to it."""
    try:
        from imageio_ffmpeg import write_frames
    except ImportError:
        return ".gif", _save_gif

    def save(path: Path, frames: Iterable[np.ndarray]) -> None:
        movie = write_frames(str(path), SIZE, fps=FPS, quality=QUALITY)
        movie.send(None)
        for frame in frames:
            movie.send(frame)
        movie.close()

    return ".mp4", save


def _save_gif(path: Path, frames: Iterable[np.ndarray]) -> None:
    """With one palette for all, that of the middle frame, so that what stands still costs nothing."""
    pictures = [Image.fromarray(frame) for frame in frames]
    palette = pictures[len(pictures) // 2].quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3)  # lines keep their colours
    first, *others = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    first.save(path, save_all=True, append_images=others, duration=1000 // FPS, loop=0)
