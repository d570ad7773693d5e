"""What a renderer is given: groups of points that move as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior.geometry.projection import View

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Cloud:
    """Points of one rigid body.

    Attributes:
        body: Whose points they are: ``floor``, ``object``, ``marker`` or ``hand``, or what a plug-in adds.
        points: (P, 3) metres, in the body's own frame.
        transforms_cloud_to_world: (4, 4) of a body at rest, or (N, 4, 4), one a time step.
    """

    body: str
    points: NDArray[np.float64]
    transforms_cloud_to_world: NDArray[np.float64]


@dataclass(frozen=True)
class Shot:
    """One camera over an episode, and what is before it.

    Attributes:
        view: The camera, fixed or moving.
        clouds: What it sees.
        steps: N, the number of frames.
    """

    view: View
    clouds: tuple[Cloud, ...]
    steps: int

    def at(self, steps: slice | NDArray[np.int64]) -> Shot:
        """The same shot at some of its time steps."""
        lens = self.view
        view = View(_some(lens.transforms_world_to_camera, steps), lens.intrinsics, lens.height, lens.width)
        clouds = tuple(
            Cloud(cloud.body, cloud.points, _some(cloud.transforms_cloud_to_world, steps))
            for cloud in self.clouds
        )
        count = len(range(self.steps)[steps]) if isinstance(steps, slice) else len(steps)
        return Shot(view, clouds, count)


def _some(transforms: NDArray[np.float64], steps: slice | NDArray[np.int64]) -> NDArray[np.float64]:
    return transforms[steps] if transforms.ndim == 3 else transforms
