"""A renderer: frames of the kind that it says, the same whole or in parts, black where nothing is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from geoprior.authoring.conformance.check import Check, digest, refuse, require
from geoprior.authoring.conformance.material import CAMERAS, builtins, scene
from geoprior.episode import FrameKind
from geoprior.errors import PluginError
from geoprior.geometry.projection import View
from geoprior.geometry.se3 import look_at
from geoprior.geometry.seeding import generator
from geoprior.hooks.types import Motion, RendererSpec
from geoprior.options import Choice
from geoprior.render import rig
from geoprior.render.clouds import Cloud, Shot
from geoprior.render.frames import draw, frame_kind
from geoprior.render.packing import pack_frames, unpack_frames
from geoprior.scene.scene import make_view

STEPS = 6


def _shots() -> Iterator[tuple[str, Shot]]:
    motion: Motion = builtins().build("motion", Choice(name="place"))
    for number in range(4):
        before = scene(number)
        shots = rig.shots(before, motion.plan(before, STEPS, generator(number, "conformance")), number)
        for camera, shot in shots.items():
            yield f"scene {number}, camera {camera!r}", shot


def _kind(spec: RendererSpec) -> FrameKind:
    return frame_kind(spec.factory(spec.config()), spec.name)


def _draw(spec: RendererSpec, shot: Shot) -> np.ndarray[Any, Any]:
    try:
        return draw(spec.factory(spec.config()), shot, spec.name)
    except PluginError as error:
        refuse(error.message, error.hint)


def frames_are_of_its_kind(spec: RendererSpec) -> None:
    """Shape and type follow from what it says that it draws; something of the scene is to be seen."""
    for where, shot in _shots():
        frames = _draw(spec, shot)
        where = f"renderer {spec.name!r}, {where}"
        require(
            _kind(spec) != "binary" or _is_packed(frames, shot.view.width),
            f"{where}: bits beyond the right edge are set",
            "give what geoprior.render.packing.pack_frames makes of your frames",
        )
        seen = frames.reshape(STEPS, -1).any(axis=1)
        require(seen.all(), f"{where}: a frame is black though the scene is in view")


def _is_packed(frames: np.ndarray[Any, Any], width: int) -> bool:
    return np.array_equal(pack_frames(unpack_frames(frames, width)), frames)


def parts_are_the_whole(spec: RendererSpec) -> None:
    """Drawn a few steps at a time, the frames are the same: this is how shards are written."""
    for where, shot in _shots():
        whole = _draw(spec, shot)
        parts = [_draw(spec, shot.at(slice(first, first + 2))) for first in range(0, STEPS, 2)]
        require(
            np.array_equal(np.concatenate(parts), whole),
            f"renderer {spec.name!r}, {where}: two steps at a time give other frames than all at once",
            "draw each step from its own transforms alone",
        )


def nothing_is_black(spec: RendererSpec) -> None:
    """No clouds give black frames, of gray and RGB too: the variant `black-images` takes all clouds away.

    No points, and points behind the camera, can be drawn; white dots on black have nothing to show then.
    """
    view = _view_of_the_origin()
    behind = Cloud("object", np.array([[0.0, 0.0, 5.0]]), np.eye(4))
    empty = Cloud("object", np.empty((0, 3)), np.eye(4))
    for name, clouds in {"no clouds": (), "no points": (empty,), "a point behind it": (behind,)}.items():
        frames = _draw(spec, Shot(view, clouds, 2))
        require(
            not frames.any() or (clouds and _kind(spec) != "binary"),
            f"renderer {spec.name!r}: {name} before the camera, and a pixel is not black",
            "without clouds give zeros, whatever colour the background has" if not clouds else "",
        )


def _view_of_the_origin() -> View:
    """A fixed camera a metre above the origin, looking down."""
    pose = look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    return make_view(CAMERAS, CAMERAS.third, pose)


def what_it_was_given_stays(spec: RendererSpec) -> None:
    """Clouds and views are not written to, and the same ones give the same frames."""
    for where, shot in _shots():
        before = digest(shot)
        first, again = _draw(spec, shot), _draw(spec, shot)
        require(digest(shot) == before, f"renderer {spec.name!r}, {where}: wrote to a cloud or a view")
        require(np.array_equal(first, again), f"renderer {spec.name!r}, {where}: draws other frames again")


CHECKS = (
    Check("its frames are what it says that it draws", frames_are_of_its_kind),
    Check("parts of an episode are drawn as the whole is", parts_are_the_whole),
    Check("nothing is drawn as black", nothing_is_black),
    Check("it writes to nothing and draws the same again", what_it_was_given_stays),
)
