"""One synthetic episode: a pure function of config, seed, motion and number."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior import __version__
from geoprior.files import sha256_json
from geoprior.geometry.se3 import invert, pose_vectors
from geoprior.geometry.seeding import generator
from geoprior.hooks.manager import plugins
from geoprior.render import rig
from geoprior.scene.mesh import extents
from geoprior.scene.scene import draw_scene
from geoprior.shards.episode import CameraHeader, Episode, EpisodeHeader

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.geometry.projection import View
    from geoprior.hooks.types import Motion, Primitive, Renderer
    from geoprior.motions.trajectory import Trajectory
    from geoprior.options import Choice
    from geoprior.scene.scene import Scene
    from geoprior.shards.config import GenerateConfig

HAND = "hand"


@dataclass(frozen=True)
class Take:
    """An episode before it is rendered.

    Attributes:
        primitive: What the object is.
        scene: Where it happens.
        trajectory: What happens.
    """

    primitive: Choice
    scene: Scene
    trajectory: Trajectory


def stage_episode(
    config: GenerateConfig, cameras: CamerasConfig, seed: int, motion: Choice, index: int
) -> Take:
    """Draw the scene and plan the motion of one episode, without rendering it.

    Raises:
        ConfigError: A name or an option is unknown, or the config leaves no room for the scene.
    """
    rng = generator(seed, "generate", motion.name, index)
    primitive = config.primitives[int(rng.integers(len(config.primitives)))]
    shape: Primitive = plugins().build("primitive", primitive)
    mover: Motion = plugins().build("motion", motion)
    scene = draw_scene(config.scene, cameras, shape.sample(rng), rng)
    return Take(primitive, scene, mover.plan(scene, config.steps, rng))


def synthesise(
    config: GenerateConfig, cameras: CamerasConfig, seed: int, motion: Choice, index: int
) -> Episode:
    """Make one episode.

    Args:
        config: The data set's config.
        cameras: Lenses and size of the frames.
        seed: Root seed.
        motion: One of the config's motions.
        index: Number of the episode within its motion.

    Returns:
        The episode. It is the same alone or in a batch, whatever else the data set holds.

    Raises:
        ConfigError: A name or an option is unknown, or the config leaves no room for the scene.
    """
    take = stage_episode(config, cameras, seed, motion, index)
    renderer: Renderer = plugins().build("renderer", config.renderer)
    pose = pose_vectors(take.trajectory.transforms_hand_to_world, take.trajectory.gripper)
    header = EpisodeHeader(
        key=f"{motion.name}-{index:06d}",
        source="synthetic",
        motion=motion.name,
        index=index,
        seed=seed,
        fps=config.fps,
        steps=len(pose),
        hands=[HAND],
        cameras=_camera_headers(take),
        generator=f"geoprior {__version__}",
        details=_details(take) | {"recipe": recipe(config, cameras, seed, motion)},
    )
    return Episode(header, pose, next_poses(pose), rig.render(renderer, take.scene, take.trajectory))


def next_poses(pose: NDArray[np.float32]) -> NDArray[np.float32]:
    """Actions (N, 8): the pose at the next step; the last repeats."""
    return np.concatenate([pose[1:], pose[-1:]])


def recipe(config: GenerateConfig, cameras: CamerasConfig, seed: int, motion: Choice) -> str:
    """SHA-256 of everything an episode of this motion is made from, its number aside.

    How many episodes there are, of which other motions, and how they are packed does not enter.
    """
    made_from = config.model_dump(mode="json", exclude={"episodes", "episodes_per_shard", "motions"})
    made_from |= {"motion": motion.model_dump(mode="json"), "cameras": cameras.model_dump(mode="json")}
    return sha256_json(made_from | {"seed": seed, "generator": __version__})


def _camera_headers(take: Take) -> list[CameraHeader]:
    scene = take.scene
    third = invert(scene.third_view.transforms_world_to_camera)
    return [
        _camera_header(rig.HAND, scene.hand_view, HAND, scene.hand.transform_camera_to_hand),
        _camera_header(rig.THIRD, scene.third_view, "world", third),
    ]


def _camera_header(
    name: str, view: View, mount: str, transform_camera_to_mount: NDArray[np.float64]
) -> CameraHeader:
    return CameraHeader(
        name=name,
        height=view.height,
        width=view.width,
        channels=1,
        intrinsics=view.intrinsics.tolist(),
        mount=mount,
        transform_camera_to_mount=transform_camera_to_mount.tolist(),
    )


def _details(take: Take) -> dict[str, Any]:
    scene, target = take.scene, take.scene.object
    return {
        "primitive": {"name": take.primitive.name, **target.mesh.parameters},
        "object": {
            "extents": extents(target.mesh).tolist(),
            "position": target.centre.tolist(),
            "yaw": target.yaw,
            "final_position": take.trajectory.transforms_object_to_world[-1, :3, 3].tolist(),
        },
        "floor": {"side": scene.floor.side, "height": scene.floor.height, "spacing": scene.floor.spacing},
        "hand_cube": scene.hand.cube,
        "marker": take.trajectory.marker_points is not None,
        "phases": [[name, len(list(steps))] for name, steps in groupby(take.trajectory.phases)],
    }
