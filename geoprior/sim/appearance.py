"""What of a model is for the eye alone: kept as it was compiled, so that each episode begins with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

FIELDS = (
    "geom_rgba",
    "geom_matid",
    "mat_rgba",
    "mat_specular",
    "mat_shininess",
    "mat_reflectance",
    "mat_texrepeat",
    "light_active",
    "light_ambient",
    "light_diffuse",
    "light_specular",
    "light_pos",
    "light_dir",
    "light_pos0",
    "light_dir0",
    "cam_pos",
    "cam_quat",
    "cam_fovy",
)
HEAD_LIGHT = ("ambient", "diffuse", "specular")


class Appearance:
    """Colours, materials, lights, cameras, and the places of geometries that collide with nothing.

    Args:
        model: As compiled.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._arrays = {name: getattr(model, name).copy() for name in FIELDS}
        self._head_light = {name: getattr(model.vis.headlight, name).copy() for name in HEAD_LIGHT}
        self._decoration = (
            (model.geom_contype == 0) & (model.geom_conaffinity == 0) & (model.geom_bodyid == 0)
        )
        self._places = model.geom_pos.copy(), model.geom_quat.copy()

    def restore(self) -> None:
        """Let the model look as it did at first."""
        for name, array in self._arrays.items():
            getattr(self._model, name)[:] = array
        for name, array in self._head_light.items():
            getattr(self._model.vis.headlight, name)[:] = array
        positions, quaternions = self._places
        self._model.geom_pos[self._decoration] = positions[self._decoration]
        self._model.geom_quat[self._decoration] = quaternions[self._decoration]
