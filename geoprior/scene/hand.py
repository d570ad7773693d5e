"""The hand: a cube, its start, and the camera behind it.

The hand's origin is the middle of the cube's front face, where a gripper's fingertips would meet; the cube
lies behind it. So an origin just outside an object means a cube just outside it, and the pose means the
same as that of a robot's grip site.

The start's heading is the world direction of the up axis of a hand that points straight down. A tilt then
swings the whole frame from straight down to its forward axis by the least rotation. Away from straight down
along the heading this is world z made orthogonal to forward, the usual choice; unlike it, it has no
singularity at straight down, where robots work, and two hands that point almost alike have almost the same
quaternion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.interpolate import swing_frames
from geoprior.geometry.projection import View, in_view
from geoprior.geometry.se3 import TRANSFORM_CAMERA_TO_HAND_AXES, cross, invert, make_transform
from geoprior.scene.mesh import extents
from geoprior.scene.ranges import uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.config import HandConfig
    from geoprior.scene.objects import SceneObject

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Hand:
    """The hand at the start of an episode.

    Attributes:
        transform_hand_to_world: (4, 4), axes [right, up, forward].
        cube: Side of the cube, metres.
        points: (C, 3) points on the cube's surface in the hand frame; the cube spans -cube to 0 of forward.
        transform_camera_to_hand: (4, 4); the camera looks along forward with the hand's up axis up.
    """

    transform_hand_to_world: FloatArray
    cube: float
    points: FloatArray
    transform_camera_to_hand: FloatArray

    @property
    def position(self) -> FloatArray:
        """(3,) p_0 in the world, metres."""
        return np.asarray(self.transform_hand_to_world[:3, 3])


def cube_surface(side: float, count: int) -> FloatArray:
    """Lattice points on a cube's surface, ``count`` along an edge, in the hand frame."""
    return np.asarray(side * _unit_cube(count))


@lru_cache(maxsize=8)
def _unit_cube(count: int) -> FloatArray:
    line = np.linspace(-0.5, 0.5, count)
    lattice = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    shell = lattice[np.abs(lattice).max(axis=1) == 0.5]
    return np.asarray(shell - np.array([0.0, 0.0, 0.5]))


def hand_rotation(forward: FloatArray, heading: float) -> FloatArray:
    """The hand frame (3, 3) of a forward axis and a heading in radians; see this module's docstring."""
    up = np.array([np.cos(heading), np.sin(heading), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    straight_down = np.column_stack([cross(up, down), up, down])
    return np.asarray(swing_frames(straight_down, forward, np.ones(1))[0])


def draw_hand(
    config: HandConfig,
    target: SceneObject,
    floor_height: float,
    lens: View,
    margin: float,
    rng: np.random.Generator,
) -> Hand:
    """Put the hand above the floor, pointing near the object, with the object in its view.

    Args:
        config: Ranges.
        target: The object.
        floor_height: z of the floor, metres.
        lens: The hand camera's intrinsics and frame; its pose is not used.
        margin: See `in_view`.
        rng: Draws.

    Raises:
        ConfigError: No start has the whole object in view.
    """
    cube = uniform(rng, config.cube)
    mount = make_transform(TRANSFORM_CAMERA_TO_HAND_AXES, np.array([0.0, 0.0, -config.camera_distance]))
    low = max(config.height[0], extents(target.mesh)[2] + config.clearance)
    heights = (low, max(low, config.height[1]))
    vertices = target.vertices

    def draw() -> FloatArray:
        radius, turn, aim, aim_turn = rng.random(4)
        position = target.centre + _disc(config.offset, radius, turn)
        position[2] = floor_height + uniform(rng, heights)
        forward = target.centre + _disc(config.aim, aim, aim_turn) - position
        heading = np.radians(rng.uniform(-config.heading_spread, config.heading_spread))
        return make_transform(hand_rotation(forward / np.linalg.norm(forward), heading), position)

    def sees_object(transform_hand_to_world: FloatArray) -> bool:
        camera = invert(transform_hand_to_world @ mount)
        return in_view(View(camera, lens.intrinsics, lens.height, lens.width), vertices, margin)

    transform = draw_until(
        draw,
        sees_object,
        "a hand that has the whole object in view",
        "raise scene.hand.height or cameras.hand.vertical_fov, or lower scene.hand.aim",
    )
    return Hand(transform, cube, cube_surface(cube, config.cube_points), mount)


def _disc(radius: float, share: float, turn: float) -> FloatArray:
    """A horizontal offset, uniform in a disc for uniform ``share`` and ``turn``."""
    reach, angle = radius * np.sqrt(share), 2.0 * np.pi * turn
    return np.array([reach * np.cos(angle), reach * np.sin(angle), 0.0])
