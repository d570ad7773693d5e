"""Draw a model's cameras: one off-screen context a process and size, light, plain, without shadows."""

from __future__ import annotations

import atexit
import weakref
from typing import TYPE_CHECKING

import numpy as np

from geoprior.errors import MachineError
from geoprior.sim.backend import GL_REMEDY, choose_gl

BACKEND = choose_gl()

import mujoco  # noqa: E402 - reads MUJOCO_GL when imported

from geoprior.sim.culling import Boxes  # noqa: E402 - imports mujoco

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_OFF = (
    mujoco.mjtRndFlag.mjRND_SHADOW,
    mujoco.mjtRndFlag.mjRND_REFLECTION,
    mujoco.mjtRndFlag.mjRND_SKYBOX,
    mujoco.mjtRndFlag.mjRND_HAZE,
)
VISUAL_GROUP = 1
"""robosuite's geometry group of what is looked at; group 0 is what collides."""


class Views:
    """Renders named cameras of one model.

    Make it in the process that uses it, never before workers are started. Without multisampling, shadows,
    reflections and sky: a frame then costs a software renderer a tenth of the default's time. Meshes and
    textures are uploaded once, so that any model that shares them can be drawn.

    Args:
        model: Compiled; its offscreen size and quality are changed.
        cameras: Names of cameras in the model.
        height: Rows of every frame.
        width: Columns of every frame.

    Raises:
        MachineError: No rendering context can be made.
    """

    def __init__(self, model: mujoco.MjModel, cameras: Sequence[str], height: int, width: int) -> None:
        self._names = tuple(cameras)
        model.vis.quality.offsamples = 0
        model.vis.quality.shadowsize = 0
        model.vis.global_.offheight = height
        model.vis.global_.offwidth = width
        self._context = _gl_context(width, height)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 50)
        for flag in _OFF:
            self._scene.flags[flag] = 0
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = 0
        self._option.geomgroup[VISUAL_GROUP] = 1
        self._option.sitegroup[:] = 0
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        _open.add(self)
        self._cameras = [_fixed_camera(model, name) for name in self._names]
        self._boxes = Boxes(model, VISUAL_GROUP)

    def draw(self, model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, NDArray[np.uint8]]:
        """Frames (H, W, 3) RGB of every camera, top row first.

        Args:
            model: The one of the constructor, or one that differs in appearance alone.
            data: With positions of geometries, cameras and lights up to date.
        """
        self._context.make_current()
        boxes = self._boxes.of(model)
        corners = boxes.corners(data)
        return {
            name: self._draw_camera(boxes, data, camera, corners)
            for name, camera in zip(self._names, self._cameras, strict=True)
        }

    def close(self) -> None:
        """Free the context's memory."""
        if self in _open:
            _open.discard(self)
            self._context.make_current()
            self._renderer.free()
            self._context.free()

    def _draw_camera(
        self, boxes: Boxes, data: mujoco.MjData, camera: mujoco.MjvCamera, corners: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        aspect = self._rectangle.width / self._rectangle.height
        with boxes.hidden(boxes.outside(data, corners, camera.fixedcamid, aspect)):
            # The head light sits on the first camera in every camera's picture.
            mujoco.mjv_updateScene(
                boxes.model,
                data,
                self._option,
                None,
                self._cameras[0],
                mujoco.mjtCatBit.mjCAT_ALL,
                self._scene,
            )
        mujoco.mjv_updateCamera(boxes.model, data, camera, self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._renderer)
        frame = np.empty((self._rectangle.height, self._rectangle.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(frame, None, self._rectangle, self._renderer)
        # OpenGL's first row is the lowest one.
        return np.ascontiguousarray(frame[::-1])


class Eyes:
    """The views of environments whose models differ in appearance alone, made when first needed.

    Args:
        cameras: Names of cameras in the models.
    """

    def __init__(self, cameras: Sequence[str]) -> None:
        self._cameras = tuple(cameras)
        self._views: dict[tuple[int, int], Views] = {}

    def draw(
        self, model: mujoco.MjModel, data: mujoco.MjData, height: int, width: int
    ) -> dict[str, NDArray[np.uint8]]:
        """See `Views.draw`.

        Raises:
            MachineError: No rendering context can be made.
        """
        size = (height, width)
        if size not in self._views:
            self._views[size] = Views(model, self._cameras, height, width)
        return self._views[size].draw(model, data)

    def close(self) -> None:
        """Free the rendering contexts; the next picture makes new ones."""
        while self._views:
            self._views.popitem()[1].close()


def _fixed_camera(model: mujoco.MjModel, name: str) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
    camera.fixedcamid = model.camera(name).id
    return camera


def _gl_context(width: int, height: int) -> mujoco.GLContext:
    try:
        if BACKEND == "osmesa":
            from mujoco.osmesa import GLContext
        else:
            from mujoco.egl import GLContext
        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # the bindings raise ImportError, RuntimeError, AttributeError or GLError
        raise MachineError(f"OpenGL through {BACKEND} does not work here: {error}", GL_REMEDY) from error
    # Registered after the bindings' own hook, so that it runs before that takes the display away.
    atexit.unregister(_close_all)
    atexit.register(_close_all)
    return context


def _close_all() -> None:
    for views in list(_open):
        views.close()


_open: weakref.WeakSet[Views] = weakref.WeakSet()
