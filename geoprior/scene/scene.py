"""A whole scene, and how it is drawn: floor, objects, hands, third-person camera, in this order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.projection import View, in_view
from geoprior.geometry.se3 import apply, invert, look_at
from geoprior.geometry.seeding import child
from geoprior.scene.arm import Arm, draw_arm
from geoprior.scene.floor import Floor, draw_floor
from geoprior.scene.hand import HAND, Hand, draw_hands
from geoprior.scene.objects import OBJECT, WORLD_UP, SceneObject, draw_beside, draw_object
from geoprior.scene.ranges import uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.camera import CameraConfig, CamerasConfig
    from geoprior.scene.config import MarkerConfig, OtherConfig, SceneConfig, ThirdCameraConfig
    from geoprior.scene.mesh import Mesh

    FloatArray = NDArray[np.float64]


_LENSES = (2.0, 160.0)
"""Vertical fields of view that an episode's lens keeps to, degrees."""


@dataclass(frozen=True)
class Scene:
    """What a motion starts from.

    Attributes:
        floor: The plane.
        object: The object that the hands have to do with, at rest.
        hands: The hands at their starts, by name, in pose order.
        third_view: The fixed third-person camera.
        marker: How a motion that has a goal draws it.
        margin: What must be in a view stays this far from its edges, in frame heights.
        others: Further objects at rest, by the names that the motion's spec gives them.
        arms: What carries the hands, by the hands' names; none where none is drawn.
        distractors: Solids at rest that have nothing to do with what happens.
    """

    floor: Floor
    object: SceneObject
    hands: Mapping[str, Hand]
    third_view: View
    marker: MarkerConfig
    margin: float
    others: Mapping[str, SceneObject] = field(default_factory=dict)
    arms: Mapping[str, Arm] = field(default_factory=dict)
    distractors: Sequence[SceneObject] = ()

    @property
    def objects(self) -> dict[str, SceneObject]:
        """All objects, by name; `object` comes first."""
        return {OBJECT: self.object, **self.others}

    @property
    def hand(self) -> Hand:
        """The hand named ``hand``: the only one, unless the motion's spec names others."""
        return self.hands[HAND]


def draw_scene(
    config: SceneConfig,
    cameras: CamerasConfig,
    mesh: Mesh,
    rng: np.random.Generator,
    hands: Sequence[str] = (HAND,),
    others: Mapping[str, tuple[OtherConfig, Mesh]] | None = None,
) -> Scene:
    """Draw a scene in which the first frames hold what they must.

    Every hand's camera has the object in view at the start (see `draw_hands`), the third-person camera all
    objects and all of the hands' cubes.

    Args:
        config: Ranges.
        cameras: Lenses and size of the frames.
        mesh: The object.
        rng: Draws.
        hands: Names of the hands.
        others: Further objects by name, and where each shall rest.

    Raises:
        ConfigError: The config leaves no room for that.
    """
    floor = draw_floor(config.floor, rng)
    target = draw_object(config.object, mesh, floor, rng)
    beside: dict[str, SceneObject] = {}
    for name, (where, solid) in (others or {}).items():
        there = [target, *beside.values()]
        beside[name] = draw_beside(where, config.object.density, solid, floor, there, rng)
    objects = [target, *beside.values()]
    own = child(rng, "lenses")
    camera = partial(make_view, cameras, _lens_of_episode(cameras.hand, config.hand.lens, own))
    drawn = draw_hands(config.hand, hands, objects, floor.height, camera, config.margin, rng)
    lens = _lens_of_episode(cameras.third, config.third.lens, own)
    third = _draw_third_view(config, partial(make_view, cameras, lens), objects, list(drawn.values()), rng)
    return Scene(
        floor=floor,
        object=target,
        hands=drawn,
        third_view=third,
        marker=config.marker,
        margin=config.margin,
        others=beside,
        arms={name: draw_arm(config.arm, floor, child(rng, "arm", name)) for name in hands if config.arm},
    )


def make_view(cameras: CamerasConfig, lens: CameraConfig, transforms_camera_to_world: FloatArray) -> View:
    """A view with a lens at one pose (4, 4) or many (N, 4, 4)."""
    intrinsics = pinhole_intrinsics(cameras.height, cameras.width, lens.vertical_fov)
    return View(invert(transforms_camera_to_world), intrinsics, cameras.height, cameras.width)


def _lens_of_episode(lens: CameraConfig, spread: float, own: np.random.Generator) -> CameraConfig:
    """The lens of one episode's camera: the config's, or one that is off by up to ``spread`` degrees."""
    if not spread:
        return lens
    off = lens.vertical_fov + own.uniform(-spread, spread)
    return lens.model_copy(update={"vertical_fov": float(np.clip(off, *_LENSES))})


def _draw_third_view(
    config: SceneConfig,
    camera: Callable[[FloatArray], View],
    objects: Sequence[SceneObject],
    hands: Sequence[Hand],
    rng: np.random.Generator,
) -> View:
    midpoint = np.mean([objects[0].centre, *(hand.position for hand in hands)], axis=0)
    cubes = [apply(hand.transform_hand_to_world, hand.points) for hand in hands]
    needed = np.vstack([*(each.vertices for each in objects), *cubes])
    own, spread = child(rng, "third"), config.third.target

    def draw() -> View:
        position = midpoint + _offset(config.third, rng)
        target = midpoint + own.uniform(-spread, spread, 3) if spread else midpoint
        return camera(look_at(position, target, WORLD_UP))

    return draw_until(
        draw,
        lambda view: in_view(view, needed, config.margin),
        "a third-person camera that has objects and hands in view",
        "raise scene.third.distance or cameras.third.vertical_fov",
    )


def _offset(config: ThirdCameraConfig, rng: np.random.Generator) -> FloatArray:
    distance = uniform(rng, config.distance)
    azimuth = np.radians(uniform(rng, config.azimuth))
    elevation = np.radians(uniform(rng, config.elevation))
    level = np.cos(elevation)
    direction = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
    return np.asarray(distance * np.array(direction))
