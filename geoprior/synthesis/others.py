"""The further objects that a motion's scenes have: what its spec says of them, and what must hold of that."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geoprior.errors import PluginError
from geoprior.scene.objects import OBJECT

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic import BaseModel

    from geoprior.hooks.types import MotionSpec
    from geoprior.motions.trajectory import Trajectory
    from geoprior.options import Choice
    from geoprior.scene.config import OtherConfig
    from geoprior.scene.scene import Scene

TAKEN = frozenset({OBJECT, "floor", "marker", "hand"})
"""Names of the bodies that scenes have without them."""


def others_of(spec: MotionSpec, options: BaseModel) -> Mapping[str, OtherConfig]:
    """The further objects of a motion's scenes with these options, by name, and where each rests.

    Raises:
        PluginError: The motion's spec names one like a body that every scene has.
    """
    others = spec.others(options)
    taken = sorted(TAKEN & others.keys())
    if taken:
        raise PluginError(
            f"motion {spec.name!r}: its spec names a further object {taken[0]!r}",
            f"every scene has a body of that name; name it otherwise than {', '.join(sorted(TAKEN))}",
        )
    return others


def require_known_objects(motion: Choice, scene: Scene, trajectory: Trajectory) -> None:
    """Refuse a trajectory that moves what is not there.

    Raises:
        PluginError: Naming the motion and the object.
    """
    unknown = sorted(trajectory.others.keys() - scene.others.keys())
    if unknown:
        raise PluginError(
            f"motion {motion.name!r}: moves {unknown[0]!r}, which its scene does not have",
            f"its spec's `others` names: {', '.join(scene.others) or 'none'}",
        )
