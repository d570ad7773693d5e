"""Synthetic episodes: pure functions of config, seed, motion and number."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior import __version__
from geoprior.files import sha256_json
from geoprior.geometry.se3 import invert, pose_vectors
from geoprior.geometry.seeding import generator
from geoprior.hooks.manager import plugins
from geoprior.render import rig
from geoprior.render.variation import vary
from geoprior.scene.mesh import extents
from geoprior.scene.scene import draw_scene
from geoprior.shards.episode import CameraHeader, Episode, EpisodeHeader
from geoprior.shards.sample import Sample, block_slices

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.geometry.projection import View
    from geoprior.hooks.types import Motion, Primitive, Renderer, Variant
    from geoprior.motions.trajectory import Trajectory
    from geoprior.options import Choice
    from geoprior.render.clouds import Shot
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
        shots: What each camera sees of it, by name in alphabetical order.
    """

    primitive: Choice
    scene: Scene
    trajectory: Trajectory
    shots: Mapping[str, Shot]


class Studio:
    """Makes the episodes of one data set; what they share is built once.

    Every episode is a pure function of config, cameras, seed, motion and number: the same alone or in a
    batch, whatever else the data set holds.

    Args:
        config: The data set's config.
        cameras: Lenses and size of the frames.
        seed: Root seed.

    Raises:
        ConfigError: A name or an option is unknown.
    """

    def __init__(self, config: GenerateConfig, cameras: CamerasConfig, seed: int) -> None:
        self.config, self.cameras, self.seed = config, cameras, seed
        build = plugins().build
        self.renderer: Renderer = build("renderer", config.renderer)
        self._shapes: list[Primitive] = [build("primitive", choice) for choice in config.primitives]
        self._variants: list[Variant] = [build("variant", choice) for choice in config.variants]
        self._motions: dict[str, tuple[Motion, str]] = {}

    def stage(self, motion: Choice, index: int) -> Take:
        """Draw the scene and plan the motion of one episode, without rendering it.

        Args:
            motion: One of the config's motions, or another one.
            index: Number of the episode within its motion.

        Raises:
            ConfigError: The motion or an option is unknown, or the config leaves no room for the scene.
        """
        rng = generator(self.seed, "generate", motion.name, index)
        kind = int(rng.integers(len(self._shapes)))
        scene = draw_scene(self.config.scene, self.cameras, self._shapes[kind].sample(rng), rng)
        trajectory = self._motion(motion)[0].plan(scene, self.config.steps, rng)
        shots = vary(rig.shots(scene, trajectory), self._variants)
        return Take(self.config.primitives[kind], scene, trajectory, shots)

    def sample(self, motion: Choice, index: int) -> Sample:
        """Make one episode as it is written; its frames are drawn when they are asked for. See `stage`."""
        take = self.stage(motion, index)
        header, pose = self._header_and_pose(take, motion, index)
        frames = {name: partial(self._blocks, shot) for name, shot in take.shots.items()}
        return Sample(header, pose, next_poses(pose), frames)

    def episode(self, motion: Choice, index: int) -> Episode:
        """Make one episode in memory; see `stage`."""
        take = self.stage(motion, index)
        header, pose = self._header_and_pose(take, motion, index)
        images = {name: rig.render(self.renderer, shot) for name, shot in take.shots.items()}
        return Episode(header, pose, next_poses(pose), images)

    def recipe(self, motion: Choice) -> str:
        """See `recipe`."""
        return self._motion(motion)[1]

    def _motion(self, motion: Choice) -> tuple[Motion, str]:
        key = motion.model_dump_json()
        if key not in self._motions:
            made: Motion = plugins().build("motion", motion)
            self._motions[key] = made, recipe(self.config, self.cameras, self.seed, motion)
        return self._motions[key]

    def _blocks(self, shot: Shot) -> Iterator[NDArray[np.uint8]]:
        frame_bytes = shot.view.height * -(-shot.view.width // 8)
        for steps in block_slices(shot.steps, frame_bytes):
            part = shot.at(steps)
            yield self.renderer.render(part.clouds, part.view, part.steps)

    def _header_and_pose(
        self, take: Take, motion: Choice, index: int
    ) -> tuple[EpisodeHeader, NDArray[np.float32]]:
        config = self.config
        pose = pose_vectors(take.trajectory.transforms_hand_to_world, take.trajectory.gripper)
        header = EpisodeHeader(
            key=f"{motion.name}-{index:06d}",
            source="synthetic",
            motion=motion.name,
            index=index,
            seed=self.seed,
            fps=config.fps,
            steps=len(pose),
            hands=[HAND],
            cameras=_camera_headers(take),
            generator=f"geoprior {__version__}",
            details=_details(take) | _named_variants(config) | {"recipe": self.recipe(motion)},
        )
        return header, pose


def stage_episode(
    config: GenerateConfig, cameras: CamerasConfig, seed: int, motion: Choice, index: int
) -> Take:
    """Stage one episode alone; see `Studio.stage`."""
    return Studio(config, cameras, seed).stage(motion, index)


def synthesise(
    config: GenerateConfig, cameras: CamerasConfig, seed: int, motion: Choice, index: int
) -> Episode:
    """Make one episode alone; see `Studio.episode`."""
    return Studio(config, cameras, seed).episode(motion, index)


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


def _named_variants(config: GenerateConfig) -> dict[str, list[str]]:
    return {"variants": [variant.name for variant in config.variants]} if config.variants else {}


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
