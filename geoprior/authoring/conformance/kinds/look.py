"""A look: other pictures of the same physics, by the seed, with nothing left over."""

from __future__ import annotations

import numpy as np

from geoprior.authoring.conformance.check import Check, require
from geoprior.authoring.conformance.stage import frames, states, world_with
from geoprior.hooks.types import LookSpec

SEED = 6


def physics_feels_nothing(spec: LookSpec) -> None:
    """The same initial state and commands give the same states as the plain look, to the bit."""
    plain, mine = states(world_with(), SEED), states(world_with(spec), SEED)
    require(
        plain.shape == mine.shape and np.array_equal(plain, mine),
        f"look {spec.name!r}: the arm or the objects move otherwise than in the plain look",
        "write only what geoprior.sim.appearance.FIELDS names; what you add collides with nothing",
    )


def a_seed_decides_the_pictures(spec: LookSpec) -> None:
    """The same seed gives the same frames, after other episodes too."""
    env = world_with(spec)
    first = frames(env, SEED)
    for other in range(5):
        env.reset(other)
    for camera, again in frames(env, SEED).items():
        require(
            np.array_equal(first[camera], again),
            f"look {spec.name!r}, camera {camera!r}: the same seed looks different after other episodes",
            "draw from the argument of `dress` alone; write only what geoprior.sim.appearance.FIELDS names",
        )


def headers_say_where_cameras_are(spec: LookSpec) -> None:
    """Every camera of the frames is described, and its transform is a rigid one."""
    env = world_with(spec)
    seen = frames(env, SEED)
    headers = env.camera_headers()
    require(
        [header.name for header in headers] == sorted(seen), f"look {spec.name!r}: cameras {sorted(seen)}"
    )
    for header in headers:
        rotation = np.array(header.transform_camera_to_mount)[:3, :3]
        require(
            np.abs(rotation.T @ rotation - np.eye(3)).max() < 1e-6,
            f"look {spec.name!r}, camera {header.name!r}: its quaternion is not of unit length",
        )


CHECKS = (
    Check("physics feels nothing of it", physics_feels_nothing, slow=True),
    Check("a seed decides the pictures, and nothing else does", a_seed_decides_the_pictures, slow=True),
    Check("headers say where the cameras are", headers_say_where_cameras_are, slow=True),
)
