"""A whole scene, and how it is drawn: floor, object, hand, third-person camera, in this order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.projection import View, in_view
from geoprior.geometry.se3 import apply, invert, look_at
from geoprior.scene.floor import Floor, draw_floor
from geoprior.scene.hand import Hand, draw_hand
from geoprior.scene.objects import WORLD_UP, SceneObject, draw_object
from geoprior.scene.ranges import uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.camera import CameraConfig, CamerasConfig
    from geoprior.scene.config import MarkerConfig, SceneConfig, ThirdCameraConfig
    from geoprior.scene.mesh import Mesh

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """What a motion starts from.

    Attributes:
        floor: The plane.
        object: The object at rest.
        hand: The hand at its start.
        hand_view: The hand camera at its start.
        third_view: The fixed third-person camera.
        marker: How a motion that has a goal draws it.
        margin: What must be in a view stays this far from its edges, in frame heights.
    """

    floor: Floor
    object: SceneObject
    hand: Hand
    hand_view: View
    third_view: View
    marker: MarkerConfig
    margin: float


def draw_scene(config: SceneConfig, cameras: CamerasConfig, mesh: Mesh, rng: np.random.Generator) -> Scene:
    """Draw a scene in which both first frames hold what they must.

    The hand camera has the whole object in view at the start, the third-person camera the whole object and
    the whole hand cube.

    Raises:
        ConfigError: The config leaves no room for that.
    """
    floor = draw_floor(config.floor, rng)
    target = draw_object(config.object, mesh, floor, rng)
    lens = make_view(cameras, cameras.hand, np.eye(4))
    hand = draw_hand(config.hand, target, floor.height, lens, config.margin, rng)
    transform = hand.transform_hand_to_world @ hand.transform_camera_to_hand
    third = _draw_third_view(config, cameras, target, hand, rng)
    return Scene(
        floor=floor,
        object=target,
        hand=hand,
        hand_view=make_view(cameras, cameras.hand, transform),
        third_view=third,
        marker=config.marker,
        margin=config.margin,
    )


def make_view(cameras: CamerasConfig, lens: CameraConfig, transforms_camera_to_world: FloatArray) -> View:
    """A view with a lens at one pose (4, 4) or many (N, 4, 4)."""
    intrinsics = pinhole_intrinsics(cameras.height, cameras.width, lens.vertical_fov)
    return View(invert(transforms_camera_to_world), intrinsics, cameras.height, cameras.width)


def _draw_third_view(
    config: SceneConfig, cameras: CamerasConfig, target: SceneObject, hand: Hand, rng: np.random.Generator
) -> View:
    midpoint = 0.5 * (target.centre + hand.position)
    needed = np.vstack([target.vertices, apply(hand.transform_hand_to_world, hand.points)])

    def draw() -> View:
        position = midpoint + _offset(config.third, rng)
        return make_view(cameras, cameras.third, look_at(position, midpoint, WORLD_UP))

    return draw_until(
        draw,
        lambda view: in_view(view, needed, config.margin),
        "a third-person camera that has object and hand in view",
        "raise scene.third.distance or cameras.third.vertical_fov",
    )


def _offset(config: ThirdCameraConfig, rng: np.random.Generator) -> FloatArray:
    distance = uniform(rng, config.distance)
    azimuth = np.radians(uniform(rng, config.azimuth))
    elevation = np.radians(uniform(rng, config.elevation))
    level = np.cos(elevation)
    direction = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
    return np.asarray(distance * np.array(direction))
