"""A video of the gantry along its contour, from a run that is already there."""

import os
import platform
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float
from PIL import Image

from experiments.files import checks, run_folder
from experiments.video.film import Film, VideoError
from experiments.video.frames import PICTURE, SIZE, Frames, error_factor, least_round, twist_factor
from jcontour.plant import Plant, State
from jcontour.plants.gantry.parameters import GantryParameters
from jcontour.wrapper import unwrapped

FPS = 25
SHORTEST, LONGEST = 5.0, 14.0  # [s] of the video
SEGMENTS = 240  # of the path on the table
QUALITY = 8  # of an MP4, of 10: lines stay sharp
COLOURS = 64  # of a GIF


class Playback(NamedTuple):
    """Seconds of the run per second of the video, and the samples that are shown."""

    speed: float
    samples: np.ndarray

    @classmethod
    def of(cls, time: np.ndarray) -> "Playback":
        """Real time, or a round number of times slower or faster.

        The number is the least that keeps the video within `SHORTEST` and `LONGEST`.
        """
        duration = float(time[-1] - time[0])
        if duration < SHORTEST:
            speed = 1 / least_round(SHORTEST / duration)
        else:
            speed = max(1.0, least_round(duration / LONGEST))
        shown = np.arange(int(duration / speed * FPS) + 1) * speed / FPS
        return cls(speed, np.rint(shown / duration * (len(time) - 1)).astype(int))

    @property
    def words(self) -> str:
        """Speed in words."""
        if self.speed == 1:
            return "real time"
        return f"slowed {1 / self.speed:.4g} x" if self.speed < 1 else f"sped up {self.speed:.4g} x"


def pose(plant: Plant, state: State) -> Float[Array, "3"]:
    """Pose (x_h, y_N, theta) of the gantry behind sensors, delays and limits.

    A replay has to watch it.
    """
    gantry, inner_state = unwrapped(plant, state)
    return gantry.measure(inner_state)[:3]


def record(parameters: GantryParameters, film: Film, folder: Path) -> dict[str, Any]:
    """Draw the film and write it into the folder; its file, pace and factors.

    The file is an MP4 where the optional packages are installed, a GIF elsewhere.

    Raises:
        VideoError: there is no OpenGL, or another MuJoCo.
    """
    playback = Playback.of(film.time)
    path = film.path[np.linspace(0, len(film.path) - 1, SEGMENTS + 1).astype(int)]
    suffix, save = _format()
    with _scene(parameters, path) as scene:
        frames = Frames(scene, parameters, film, playback.words)
        file = run_folder.write(
            folder / f"video{suffix}",
            lambda temporary: save(temporary, map(frames.pixels, playback.samples)),
        )
    twist = float(np.abs(film.pose[:, 2]).max())
    turned, off = twist_factor(film), error_factor(film)
    return {
        "file": file.name,
        "pace": playback.words,
        "seconds": len(playback.samples) / FPS,
        "twist_factor": turned,
        "error_factor": off,
        "peak_twist_rad": twist,
        "magnified": f"twist x {turned:,} (peak {1e6 * twist:.3g} urad), contour error x {off:,}",
    }


def _scene(parameters: GantryParameters, path: np.ndarray):
    """A `scene.Scene`: it imports the engine, and OpenGL with it."""
    if platform.system() == "Linux":
        # needs no display; the engine reads it when it is first imported
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import_module("jcontour.plants.gantry.engines.mujoco_engine")
    except ImportError as error:  # names the version that is needed
        raise VideoError(f"video: {checks.line(error)}") from None
    except Exception as error:  # every OpenGL, and what may be missing of it, raises another
        raise _no_opengl(error) from error
    scene = import_module("experiments.video.scene")
    try:
        return scene.Scene(parameters, path, PICTURE)
    except scene.OpenGLError as error:
        raise _no_opengl(error) from error


def _no_opengl(error: Exception) -> VideoError:
    how = os.environ.get("MUJOCO_GL") or "not set"
    return VideoError(
        f"video: OpenGL cannot be opened (MUJOCO_GL is {how}: {checks.line(error)}); "
        "install it (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri) "
        "or set MUJOCO_GL to another: egl, osmesa, glfw"
    )


def _format() -> tuple[str, Callable[[Path, Iterable[np.ndarray]], None]]:
    """Suffix of the file, and the function that writes frames to it."""
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
    """Write a GIF with one palette, that of the middle frame: still pixels then cost nothing."""
    pictures = [Image.fromarray(frame) for frame in frames]
    middle = pictures[len(pictures) // 2]
    # lines keep their colours
    palette = middle.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3)
    undithered = Image.Dither.NONE
    first, *others = (one.quantize(palette=palette, dither=undithered) for one in pictures)
    first.save(path, save_all=True, append_images=others, duration=1000 // FPS, loop=0)
