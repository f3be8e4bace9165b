"""Pictures of the gantry by MuJoCo: the machine at a pose, its path on the table.

It loads OpenGL, which a computer may not have.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Self

import numpy as np

from experiments.files import checks
from jcontour.plants.gantry.engines.mjcf import ENGINE_ORDER, TABLE, mjcf
from jcontour.plants.gantry.engines.mujoco_engine import loaded, mujoco
from jcontour.plants.gantry.parameters import GantryParameters

# pyright: reportAttributeAccessIssue=false
# (the engine's names are compiled: no type checker sees them)

PATH_RADIUS, STRAIGHT_RADIUS = 0.004, 0.003  # [m] of the lines that are drawn
PATH_COLOUR, STRAIGHT_COLOUR = (0.1, 0.3, 0.75, 1.0), (0.85, 0.1, 0.1, 1.0)
ABOVE_BEAM = 0.06  # [m]
# [degrees] of the camera from the horizon: the beam's angle shows, and so do the drives
TILT = -60.0
DISTANCE = 2.75  # of the camera, in half spans with their drives


class OpenGLError(Exception):
    """No OpenGL can be opened."""


class Scene(AbstractContextManager):
    """The machine and the path (P, 2) [m] on its table; `picture` puts it to a pose.

    Close it, or use it in a `with`.

    Raises:
        OpenGLError: no OpenGL can be opened.
    """

    def __init__(self, parameters: GantryParameters, path: np.ndarray, size: tuple[int, int]):
        self._model = loaded(mjcf(parameters, 1e-3))  # nothing is stepped
        self._data = mujoco.MjData(self._model)
        self._reach, self._offset = float(parameters.half_span), float(parameters.tool_offset)
        self._path = np.column_stack([path, np.full(len(path), TABLE)])
        self._camera = mujoco.MjvCamera()
        self._camera.lookat[:] = 0.0, path[:, 1].mean() + self._offset / 4, 0.0
        self._camera.azimuth, self._camera.elevation = 90.0, TILT
        self._camera.distance = DISTANCE * (self._reach + float(parameters.joint_length))
        self._shown = mujoco.MjvOption()
        self._shown.sitegroup[:] = False
        self._renderer = _opened(self._model, size)
        shadows = mujoco.mjtRndFlag.mjRND_SHADOW  # half the time where the processor draws
        self._renderer.scene.flags[shadows] = False

    def picture(self, pose: np.ndarray, straight: float) -> np.ndarray:
        """Pixels (height, width, 3) of the machine at a pose.

        Args:
            pose: (x_h, y_N, theta) [m, m, rad].
            straight: y of the line that is drawn where the beam's axis would be without twist [m].
        """
        self._data.qpos[:] = pose[ENGINE_ORDER]
        mujoco.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, self._camera, self._shown)
        for start, end in zip(self._path[:-1], self._path[1:], strict=True):
            self._line(start, end, PATH_RADIUS, PATH_COLOUR)
        ends = [(side * self._reach, straight, ABOVE_BEAM) for side in (-1, 1)]
        self._line(*ends, STRAIGHT_RADIUS, STRAIGHT_COLOUR)
        return self._renderer.render()

    def _line(
        self, start: Sequence[float], end: Sequence[float], radius: float, colour: tuple[float, ...]
    ) -> None:
        scene = self._renderer.scene
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(
            geom,
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            np.zeros(3),
            np.zeros(3),
            np.zeros(9),
            np.array(colour, np.float32),
        )
        mujoco.mjv_connector(
            geom,
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            radius,
            np.asarray(start, float),
            np.asarray(end, float),
        )
        scene.ngeom += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_) -> None:
        self._renderer.close()


def _opened(model: "mujoco.MjModel", size: tuple[int, int]) -> "mujoco.Renderer":
    try:
        return mujoco.Renderer(model, height=size[1], width=size[0])
    except Exception as error:  # every OpenGL raises another
        raise OpenGLError(checks.line(error)) from error
