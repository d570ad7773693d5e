"""What there is to draw of an episode in space: its hands, its cameras, and the bodies around them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from geoprior.episode import POSE_SIZE, WORLD
from geoprior.geometry.se3 import transforms_of_poses
from geoprior.motions.trajectory import ways_of_objects
from geoprior.render import rig
from geoprior.view.outline import Solid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.episode import CameraHeader, EpisodeHeader
    from geoprior.render.clouds import Cloud
    from geoprior.synthesis.studio import Take

    FloatArray = NDArray[np.float64]

Told = TypeVar("Told", bound=BaseModel)


class ObjectDetails(BaseModel):
    """What a header may tell of an object, metres: enough for its box at the start and at the end."""

    model_config = ConfigDict(allow_inf_nan=False)

    extents: tuple[float, float, float]
    position: tuple[float, float, float]
    yaw: float = 0.0
    final_position: tuple[float, float, float] | None = None


class FloorDetails(BaseModel):
    """What a header may tell of the floor, metres; without it, a table's top in the workspace frame."""

    model_config = ConfigDict(allow_inf_nan=False)

    side: float = Field(0.8, gt=0.0, le=100.0)
    height: float = 0.0


@dataclass(frozen=True)
class Hand:
    """One hand over an episode.

    Attributes:
        transforms_hand_to_world: (N, 4, 4).
        closed: (N,) bool, whether the gripper is.
    """

    transforms_hand_to_world: FloatArray
    closed: NDArray[np.bool_]


@dataclass(frozen=True)
class Camera:
    """One camera over an episode.

    Attributes:
        name: Of the view.
        transforms_camera_to_world: (4, 4) of a fixed camera, (N, 4, 4) of one that rides on a hand.
        rays: (4, 3) from the camera through the frame's corners in turn, top left first, to depth 1.
    """

    name: str
    transforms_camera_to_world: FloatArray
    rays: FloatArray


@dataclass(frozen=True)
class Bodies:
    """What is known of an episode's bodies beyond its header.

    Attributes:
        clouds: Their points.
        solids: The surfaces of some of them.
    """

    clouds: tuple[Cloud, ...]
    solids: tuple[Solid, ...]


@dataclass(frozen=True)
class World:
    """An episode in the workspace frame, metres.

    Attributes:
        steps: N.
        hands: In pose order.
        cameras: Those whose place the header tells.
        floor: Side and height of the floor.
        objects: The objects' boxes where no more is known of them, and the header tells those.
        hand_cube: Side of the cube behind the hand's origin; 0 where nobody tells it.
        hand_setback: How far behind that origin the cube begins, metres.
        bodies: Points and surfaces, where they are known.
    """

    steps: int
    hands: tuple[Hand, ...]
    cameras: tuple[Camera, ...]
    floor: FloorDetails
    objects: tuple[ObjectDetails, ...]
    hand_cube: float
    bodies: Bodies
    hand_setback: float = 0.0


def world_of(header: EpisodeHeader, pose: NDArray[np.float32], bodies: Bodies | None = None) -> World:
    """Put together what an episode's header and poses tell, and its bodies if they are known.

    Args:
        header: Of the episode. Details of another form than those of synthetic episodes are left out.
        pose: (N, 8 x hands).
        bodies: See `bodies_of`; without them the boxes that the header tells are drawn.
    """
    by_hand = pose.reshape(header.steps, len(header.hands), POSE_SIZE)
    hands = tuple(
        Hand(transforms_of_poses(by_hand[:, i]), by_hand[:, i, 7] > 0.5) for i in range(len(header.hands))
    )
    mounts = dict(zip(header.hands, hands, strict=True))
    cameras = tuple(_camera(camera, mounts) for camera in header.cameras if _is_placed(camera, mounts))
    return World(
        steps=header.steps,
        hands=hands,
        cameras=cameras,
        floor=_told(FloorDetails, header.details.get("floor")) or FloorDetails(),
        objects=() if bodies else _objects(header.details),
        hand_cube=_length(header.details.get("hand_cube")),
        bodies=bodies or Bodies((), ()),
        hand_setback=_length(header.details.get("hand_setback")),
    )


def bodies_of(take: Take) -> Bodies:
    """Every point of a staged episode, what is there and what a plug-in adds; and the objects' surfaces.

    A variant that takes something from a camera does not take it out of the world.
    """
    there = rig.shots(take.scene, take.trajectory)[rig.THIRD].clouds
    known = {cloud.body for cloud in there}
    added = {cloud.body: cloud for shot in take.shots.values() for cloud in shot.clouds}
    clouds = (*there, *(cloud for body, cloud in added.items() if body not in known))
    ways = ways_of_objects(take.scene, take.trajectory)
    solids = (Solid(name, each.mesh, ways[name]) for name, each in take.scene.objects.items())
    return Bodies(clouds, tuple(solids))


def _objects(details: Mapping[str, Any]) -> tuple[ObjectDetails, ...]:
    others = details.get("others")
    found = [details.get("object"), *(others.values() if isinstance(others, dict) else ())]
    told = (_told(ObjectDetails, value) for value in found)
    return tuple(each for each in told if each is not None)


def _is_placed(camera: CameraHeader, mounts: dict[str, Hand]) -> bool:
    """Whether the header tells where a camera is and what it sees; an importer may not have known."""
    return camera.mount in {WORLD, *mounts} and bool(np.linalg.det(np.array(camera.intrinsics)))


def _camera(camera: CameraHeader, mounts: dict[str, Hand]) -> Camera:
    mounted = np.array(camera.transform_camera_to_mount)
    transforms = mounted if camera.mount == WORLD else mounts[camera.mount].transforms_hand_to_world @ mounted
    right, low = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5, 1.0], [right, -0.5, 1.0], [right, low, 1.0], [-0.5, low, 1.0]])
    to_rays: FloatArray = np.linalg.inv(np.array(camera.intrinsics, np.float64))
    return Camera(camera.name, transforms, corners @ to_rays.T)


def _told(model: type[Told], value: Any) -> Told | None:
    try:
        return model.model_validate(value)
    except ValidationError:
        return None


def _length(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and 0.0 < value < 100.0 else 0.0
