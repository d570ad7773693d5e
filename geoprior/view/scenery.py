"""Which marks a world is drawn with at a step, and what of it shall be in the picture."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.interpolate import rotations_about
from geoprior.geometry.se3 import apply, make_transform
from geoprior.view.marks import Dots, Lines, Mark, box, frustum, grid, sight, triad
from geoprior.view.outline import Outline
from geoprior.view.palette import FLOOR, HAND, OBJECT, colour_of
from geoprior.view.sheet import evenly_spaced

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.render.clouds import Cloud
    from geoprior.view.world import Camera, Hand, ObjectDetails, World

    FloatArray = NDArray[np.float64]

_FLOOR, _HAND = "floor", "hand"
_RADII = {_FLOOR: 0.0028, "marker": 0.0018, _HAND: 0.002}
_RADIUS = 0.0024
_GHOST = 0.4  # strength of what was, or will be, elsewhere
_SHADOW = 0.45
_FRUSTUM = 0.08  # metres
_PIECES = 64  # of a way, at most
_TRIADS = 6
_LOOKS = 9  # steps at which everything must be in the picture
_Z = np.array([0.0, 0.0, 1.0])


def marks_of(
    world: World, step: int, ghosts: Sequence[int] = (), ahead: float = 1.0
) -> Iterator[Mark | Outline]:
    """Everything there is to paint of a world at a step.

    Args:
        world: What to draw.
        step: In [0, N).
        ghosts: Steps at which what moves is drawn too, faintly.
        ahead: Strength of the way that is still to come.
    """
    yield from _ground(world)
    yield from _bodies(world, step, ghosts)
    yield from _hands(world, step, ghosts, ahead)
    for camera in world.cameras:
        yield from frustum(camera, step, _FRUSTUM)
        if not _rides(camera):
            yield sight(camera, world.floor.height)


def extent(world: World, *, wide: bool = False) -> FloatArray:
    """Points (P, 3) that shall be in the picture: where the hands go and what is there, or everything.

    Args:
        world: What to draw.
        wide: Whether the whole floor and the fixed cameras shall be in it too.
    """
    cameras = [camera for camera in world.cameras if wide or _rides(camera)]
    marks: list[Mark | Outline] = [*_ground(world)] if wide else []
    for step in evenly_spaced(world.steps, _LOOKS):
        marks += [*_bodies(world, step), *_hands(world, step)]
        for camera in cameras:
            marks += frustum(camera, step, _FRUSTUM)
    return np.concatenate([mark.places for mark in marks])


def _ground(world: World) -> Iterator[Mark]:
    """The floor: its edges and its points, or squares where nobody knows those."""
    points = [cloud for cloud in world.bodies.clouds if cloud.body == _FLOOR]
    pieces, strength = (1, 0.5) if points else (8, 0.4)
    yield grid(world.floor.side, world.floor.height, pieces, FLOOR, strength)
    for cloud in points:
        yield from _dots(cloud, 0, ())


def _bodies(world: World, step: int, ghosts: Sequence[int] = ()) -> Iterator[Mark | Outline]:
    for cloud in world.bodies.clouds:
        as_box = cloud.body == _HAND and world.hand_cube > 0.0
        if cloud.body != _FLOOR:
            yield from _dots(cloud, step, () if as_box else ghosts)
    for solid in world.bodies.solids:
        for at, strength in _moments(solid.transforms_solid_to_world, step, ghosts):
            yield Outline(solid, at, colour_of(solid.body), strength)
    for told in world.objects:
        yield from _object_boxes(told, last=step == world.steps - 1)


def _object_boxes(told: ObjectDetails, *, last: bool) -> Iterator[Lines]:
    """The boxes that a header tells; how the object comes from one to the other it does not tell."""
    turn, size = rotations_about(_Z, np.array([told.yaw]))[0], np.array(told.extents)
    end = told.final_position or told.position
    for place, now in {told.position: not last, end: last or end == told.position}.items():
        yield box(make_transform(turn, np.array(place)), size, OBJECT, 1.0 if now else _GHOST)


def _hands(world: World, step: int, ghosts: Sequence[int] = (), ahead: float = 1.0) -> Iterator[Mark]:
    for hand in world.hands:
        yield from _cubes(
            world.hand_cube, world.hand_setback, _moments(hand.transforms_hand_to_world, step, ghosts)
        )
        yield from _way(hand, step, ahead, world.floor.height)


def _cubes(side: float, setback: float, moments: Iterable[tuple[FloatArray, float]]) -> Iterator[Lines]:
    """The edges of the hand's cube, behind its origin."""
    behind = make_transform(np.eye(3), np.array([0.0, 0.0, -setback - 0.5 * side]))
    for transform_hand_to_world, strength in moments if side else ():
        yield box(transform_hand_to_world @ behind, np.full(3, side), HAND, strength)


def _way(hand: Hand, step: int, ahead: float, floor: float) -> Iterator[Mark]:
    """The hand's way, thick where the gripper is closed, its shadow, and the hand's frame here and there."""
    transforms = hand.transforms_hand_to_world
    at = np.array(evenly_spaced(len(transforms), _PIECES + 1))
    segments = _pairs(transforms[at, :3, 3])
    closed, past = hand.closed[at[1:]], at[1:] <= step
    for width, gripper in ((1, ~closed), (3, closed)):
        yield Lines(segments[gripper & past], width, HAND)
        yield Lines(segments[gripper & ~past], width, HAND, ahead)
    now = transforms[step, :3, 3]
    yield Lines(_pairs(_dropped(transforms[at, :3, 3], floor)), 1, FLOOR, _SHADOW)
    yield Lines(np.stack([now, _dropped(now[None], floor)[0]])[None], 1, FLOOR, _SHADOW)
    for some in evenly_spaced(len(transforms), _TRIADS):
        yield from triad(transforms[some], 0.025, 1, 0.8 if some <= step else ahead)
    yield from triad(transforms[step], 0.05, 2)


def _moments(transforms: FloatArray, step: int, ghosts: Sequence[int]) -> Iterator[tuple[FloatArray, float]]:
    """Where a body is at a step, and, fainter, where it is at others if it moves: poses and strengths."""
    if transforms.ndim == 2:
        yield transforms, 1.0
        return
    yield transforms[step], 1.0
    for ghost in ghosts:
        if not np.allclose(transforms[ghost], transforms[step], rtol=0.0, atol=1e-9):
            yield transforms[ghost], _GHOST


def _dots(cloud: Cloud, step: int, ghosts: Sequence[int]) -> Iterator[Dots]:
    for at, strength in _moments(cloud.transforms_cloud_to_world, step, ghosts):
        radius = _RADII.get(cloud.body, _RADIUS)
        yield Dots(apply(at, cloud.points), radius, colour_of(cloud.body), strength)


def _rides(camera: Camera) -> bool:
    return camera.transforms_camera_to_world.ndim == 3


def _pairs(line: FloatArray) -> FloatArray:
    return np.stack([line[:-1], line[1:]], axis=1)


def _dropped(points: FloatArray, height: float) -> FloatArray:
    return np.column_stack([points[:, :2], np.full(len(points), height)])
