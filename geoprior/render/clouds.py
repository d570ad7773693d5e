"""What a renderer is given: rigid bodies, each as points and, where it has one, a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from geoprior.geometry.projection import View

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.scene.mesh import Mesh


@dataclass(frozen=True)
class Cloud:
    """Points of one rigid body.

    Attributes:
        body: Whose points they are: ``floor``, ``object``, ``marker`` or ``hand``, or what a plug-in adds.
        points: (P, 3) metres, in the body's own frame.
        transforms_cloud_to_world: (4, 4) of a body at rest, or (N, 4, 4), one a time step.
        surface: Triangles in the same frame, for renderers that draw solids; None of a body that has points
            only.
    """

    body: str
    points: NDArray[np.float64]
    transforms_cloud_to_world: NDArray[np.float64]
    surface: Mesh | None = None


@dataclass(frozen=True)
class Shot:
    """One camera over an episode, and what is before it.

    Attributes:
        view: The camera, fixed or moving.
        clouds: What it sees.
        steps: N, the number of frames.
        seed: Of the episode, for renderers that draw colours or lights at random: the same for all cameras
            of an episode and for any of its time steps.
    """

    view: View
    clouds: tuple[Cloud, ...]
    steps: int
    seed: int = 0

    def at(self, steps: slice | NDArray[np.int64]) -> Shot:
        """The same shot at some of its time steps."""
        lens = self.view
        view = View(_some(lens.transforms_world_to_camera, steps), lens.intrinsics, lens.height, lens.width)
        clouds = tuple(
            replace(cloud, transforms_cloud_to_world=_some(cloud.transforms_cloud_to_world, steps))
            for cloud in self.clouds
        )
        count = len(range(self.steps)[steps]) if isinstance(steps, slice) else len(steps)
        return Shot(view, clouds, count, self.seed)


def _some(transforms: NDArray[np.float64], steps: slice | NDArray[np.int64]) -> NDArray[np.float64]:
    return transforms[steps] if transforms.ndim == 3 else transforms
