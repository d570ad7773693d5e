"""The hands: cubes, where they start, and the camera behind each.

A hand's origin is where a gripper's fingertips would meet: the middle of the cube's front face, so that an
origin just outside an object means a cube just outside it, or a finger's length ahead of that face
(`scene.hand.setback`), so that an object may lie between the fingers. The pose means the same as that of a
robot's grip site.

The start's heading is the world direction of the up axis of a hand that points straight down. A tilt then
swings the whole frame from straight down to its forward axis by the least rotation. Away from straight down
along the heading this is world z made orthogonal to forward, the usual choice; unlike it, it has no
singularity at straight down, where robots work, and two hands that point almost alike have almost the same
quaternion.

Hands share the circle about the object: seen from above and counted from +x towards +y, the first one starts
in the first of as many equal sectors as there are hands, the next one in the next. Their cubes are of one
size and clear of each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.interpolate import rotations_about, swing_frames
from geoprior.geometry.projection import View, in_view
from geoprior.geometry.se3 import TRANSFORM_CAMERA_TO_HAND_AXES, cross, make_transform
from geoprior.geometry.seeding import child
from geoprior.scene.fingers import Fingers, draw_fingers
from geoprior.scene.mesh import Mesh, box, extents
from geoprior.scene.ranges import uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from geoprior.scene.config import HandConfig
    from geoprior.scene.objects import SceneObject

    FloatArray = NDArray[np.float64]

HAND = "hand"
"""Name of the hand where a motion's spec names no others."""

HAND_BODIES = ("hand", "finger", "arm")
"""Names of the bodies that are drawn of a hand, and of the arm that carries it."""

_DOWN = np.array([0.0, 0.0, -1.0])
_RIGHT = np.array([1.0, 0.0, 0.0])
_NOWHERE = View(np.eye(4), np.eye(3), 1, 1)
"""Of a hand that is not anywhere yet."""


@dataclass(frozen=True)
class Hand:
    """A hand at the start of an episode.

    Attributes:
        transform_hand_to_world: (4, 4), axes [right, up, forward].
        cube: Side of the cube, metres.
        points: (C, 3) points on the cube's surface in the hand frame; the cube spans -setback - cube to
            -setback of forward.
        transform_camera_to_hand: (4, 4); the camera looks along forward with the hand's up axis up, or
            pitched from there.
        view: That camera at the start.
        setback: How far behind the hand's origin the cube's front face lies, metres.
        fingers: What there is between the cube and the origin, or None.
    """

    transform_hand_to_world: FloatArray
    cube: float
    points: FloatArray
    transform_camera_to_hand: FloatArray
    view: View
    setback: float = 0.0
    fingers: Fingers | None = None

    @property
    def position(self) -> FloatArray:
        """(3,) p_0 in the world, metres."""
        return np.asarray(self.transform_hand_to_world[:3, 3])

    def solids(self, gap: float) -> tuple[Mesh, ...]:
        """The hand's boxes in the hand frame: its cube, and its fingers ``gap`` metres apart."""
        fingers = self.fingers.pair() if self.fingers else ()
        shifts = (0.5 * gap, -0.5 * gap)
        apart = (
            Mesh(each.vertices + np.array([by, 0.0, 0.0]), each.faces)
            for each, by in zip(fingers, shifts, strict=False)
        )
        return hand_cube(self.cube, self.setback), *apart


def cube_surface(side: float, count: int) -> FloatArray:
    """Lattice points on a cube's surface, ``count`` along an edge, in the hand frame."""
    return np.asarray(side * _unit_cube(count))


def hand_cube(side: float, setback: float = 0.0) -> Mesh:
    """The cube's surface in the hand frame, metres; see `Hand`."""
    back = np.array([0.0, 0.0, setback])
    return box(np.array([-0.5, -0.5, -1.0]) * side - back, np.array([0.5, 0.5, 0.0]) * side - back)


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


def draw_hands(
    config: HandConfig,
    names: Sequence[str],
    objects: Sequence[SceneObject],
    floor_height: float,
    camera: Callable[[FloatArray], View],
    margin: float,
    rng: np.random.Generator,
) -> dict[str, Hand]:
    """Put hands above the floor, each pointing near the object, with the object in its view.

    Args:
        config: Ranges.
        names: Of the hands.
        objects: What is there. The hands point near the first one, and start above all.
        floor_height: z of the floor, metres.
        camera: Gives a hand camera's view for its pose, (4, 4) camera to world.
        margin: See `in_view`.
        rng: Draws.

    Returns:
        The hands by name, in the order of the names.

    Raises:
        ConfigError: No start has the whole object in view, or there is no room for a hand beside the others.
    """
    cube = uniform(rng, config.cube)
    own = child(rng, "hands")
    mounted = _draw_mounted(config, cube, own)
    target = objects[0]
    low = max(config.height[0], max(extents(each.mesh)[2] for each in objects) + config.clearance)
    heights = (low, max(low, config.height[1]))
    vertices = target.vertices
    middle = target.centre if config.about == "object" else target.centre * np.array([0.0, 0.0, 1.0])
    hands: dict[str, Hand] = {}

    def draw() -> Hand:
        radius, turn, aim, aim_turn = rng.random(4)
        position = middle + _disc(config.offset, radius, (len(hands) + turn) / len(names))
        position[2] = floor_height + uniform(rng, heights)
        forward = middle + _disc(config.aim, aim, aim_turn) - position
        heading = np.radians(rng.uniform(-config.heading_spread, config.heading_spread))
        if is_down[len(hands)]:
            forward = _DOWN + _disc(np.tan(np.radians(config.down_tilt)), *own.random(2))
        pose = make_transform(hand_rotation(forward / np.linalg.norm(forward), heading), position)
        return replace(
            mounted,
            transform_hand_to_world=pose,
            view=camera(pose @ mounted.transform_camera_to_hand),
        )

    def fits(hand: Hand) -> bool:
        needed = target.centre[None] if is_down[len(hands)] else vertices
        return in_view(hand.view, needed, margin) and _is_clear(hand, hands.values())

    is_down = own.random(len(names)) < config.down
    for name in names:
        hands[name] = draw_until(
            draw,
            fits,
            "a hand that has the whole object in view",
            "raise scene.hand.height or cameras.hand.vertical_fov, or lower scene.hand.aim",
        )
    return hands


def _draw_mounted(config: HandConfig, cube: float, own: np.random.Generator) -> Hand:
    """What the hands of a scene share, not yet anywhere: cube, fingers and the camera's mount."""
    setback = uniform(own, config.setback)
    mount = camera_mount(
        right=uniform(own, config.camera_right),
        up=uniform(own, config.camera_up),
        distance=_drawn(config.camera_distance, own),
        pitch=float(np.radians(uniform(own, config.camera_pitch))),
    )
    points = cube_surface(cube, config.cube_points)
    if setback:
        points = points - np.array([0.0, 0.0, setback])
    fingers = draw_fingers(config.fingers, setback, own) if config.fingers else None
    return Hand(np.eye(4), cube, points, mount, _NOWHERE, setback, fingers)


def camera_mount(right: float, up: float, distance: float, pitch: float) -> FloatArray:
    """(4, 4) camera to hand: where a camera sits, and how far it is turned towards minus up.

    Args:
        right: Metres along the hand's right axis.
        up: Metres along its up axis.
        distance: Metres behind its origin.
        pitch: Radians.
    """
    place, axes = np.array([right, up, -distance]), TRANSFORM_CAMERA_TO_HAND_AXES
    return make_transform(rotations_about(_RIGHT, np.array([pitch]))[0] @ axes if pitch else axes, place)


def _drawn(value: float | tuple[float, float], own: np.random.Generator) -> float:
    return uniform(own, value) if isinstance(value, tuple) else value


def _is_clear(hand: Hand, others: Iterable[Hand]) -> bool:
    """Whether the ball around a hand's cube meets none of the others'."""
    return all(np.linalg.norm(_middle(hand) - _middle(other)) > np.sqrt(3.0) * hand.cube for other in others)


def _middle(hand: Hand) -> FloatArray:
    """(3,) of the cube in the world."""
    behind = 0.5 * hand.cube + hand.setback
    return hand.position - behind * hand.transform_hand_to_world[:3, 2]


def _disc(radius: float, share: float, turn: float) -> FloatArray:
    """A horizontal offset, uniform in a disc for uniform ``share`` and ``turn``."""
    reach, angle = radius * np.sqrt(share), 2.0 * np.pi * turn
    return np.array([reach * np.cos(angle), reach * np.sin(angle), 0.0])
