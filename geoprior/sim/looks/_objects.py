"""Which geometries of a model belong to the task's objects."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

_OTHERS = ("robot", "gripper", "fixed_mount", "table")
"""How the names of bodies begin that no task brings."""


def object_geoms(model: mujoco.MjModel) -> list[int]:
    """Numbers of the geometries of whatever a task puts on the table."""
    names = [model.body(body).name for body in model.geom_bodyid]
    return [
        geom for geom, name in enumerate(names) if model.geom_bodyid[geom] and not name.startswith(_OTHERS)
    ]
