"""Synthetic episodes: pure functions of config, seed, motion and number."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from geoprior import __version__
from geoprior.episode import WORLD, CameraHeader, Episode, EpisodeHeader, FrameFormat, can_be_told_apart
from geoprior.errors import ConfigError, PluginError
from geoprior.files import sha256_json
from geoprior.geometry.se3 import invert
from geoprior.geometry.seeding import child, generator, integer_seed
from geoprior.hooks.manager import plugins
from geoprior.motions.trajectory import ways_of_objects
from geoprior.options import recipe_tree
from geoprior.render import frames, rig
from geoprior.render.variation import vary
from geoprior.scene.distractors import draw_distractors
from geoprior.scene.mesh import extents
from geoprior.scene.objects import OBJECT
from geoprior.scene.ranges import uniform
from geoprior.scene.scene import draw_scene
from geoprior.shards.sample import Sample, block_slices
from geoprior.synthesis.others import others_of, require_known_objects
from geoprior.synthesis.targets import compute_targets, target_names

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from geoprior.episode import FrameKind
    from geoprior.geometry.camera import CamerasConfig
    from geoprior.geometry.projection import View
    from geoprior.hooks.types import Motion, MotionSpec, Primitive, Renderer, Variant
    from geoprior.motions.trajectory import Trajectory
    from geoprior.options import Choice
    from geoprior.render.clouds import Shot
    from geoprior.scene.config import OtherConfig
    from geoprior.scene.mesh import Mesh
    from geoprior.scene.objects import SceneObject
    from geoprior.scene.scene import Scene
    from geoprior.synthesis.config import GenerateConfig

REVISION = 1
"""Raised when the same config and seed come to give other episodes."""


@dataclass(frozen=True)
class Take:
    """An episode before it is rendered.

    Attributes:
        primitive: What the object is.
        scene: Where it happens.
        trajectory: What happens.
        shots: What each camera sees of it, by name in alphabetical order.
        others: What the scene's further objects are, by name.
    """

    primitive: Choice
    scene: Scene
    trajectory: Trajectory
    shots: Mapping[str, Shot]
    others: Mapping[str, Choice] = field(default_factory=dict)


@dataclass(frozen=True)
class _Plan:
    """What the episodes of one motion share.

    Attributes:
        motion: Plans them.
        recipe: See `recipe`.
        hands: Names of the hands that it moves, in pose order.
        others: The further objects of its scenes, by name, and where each rests.
    """

    motion: Motion
    recipe: str
    hands: tuple[str, ...]
    others: Mapping[str, OtherConfig]


class Studio:
    """Makes the episodes of one data set; what they share is built once.

    Every episode is a pure function of config, cameras, seed, motion and number: the same alone or in a
    batch, whatever else the data set holds.

    Args:
        config: The data set's config.
        cameras: Lenses and size of the frames.
        seed: Root seed.
        episodes: Of each motion in an epoch; see `steps_of`. None takes the config's.

    Raises:
        ConfigError: A name or an option is unknown, or the config's motions do not move the same hands.
        PluginError: See `hands_of`.
    """

    def __init__(
        self, config: GenerateConfig, cameras: CamerasConfig, seed: int, episodes: int | None = None
    ) -> None:
        self.config, self.cameras, self.seed = config, cameras, seed
        self._episodes = episodes
        build = plugins().build
        self.renderer: Renderer = build("renderer", config.renderer)
        self.frames: FrameKind = frames.frame_kind(self.renderer, config.renderer.name)
        self._primitives: dict[str, Primitive] = {}
        for choice in config.primitives:
            self._primitive(choice)
        self._variants: list[Variant] = [build("variant", choice) for choice in config.variants]
        self._plans: dict[str, _Plan] = {}
        _require_same_hands(config.motions)

    def steps(self, motion: Choice, index: int) -> int:
        """N, the time steps of an episode; see `stage` and `steps_of`."""
        return steps_of(self.config, self.seed, motion, index, self._episodes)

    def stage(self, motion: Choice, index: int) -> Take:
        """Draw the scene and plan the motion of one episode, without rendering it.

        Args:
            motion: One of the config's motions, or another one.
            index: Number of the episode within its motion.

        Raises:
            ConfigError: The motion or an option is unknown, or the config leaves no room for the scene.
            PluginError: The motion plans ways for other hands or objects than its spec names.
        """
        rng = generator(self.seed, "generate", motion.name, index)
        primitive, mesh = self._draw_solid(self.config.primitives, rng)
        plan = self._plan(motion)
        drawn = {
            name: self._draw_solid(where.primitives or self.config.primitives, rng)
            for name, where in plan.others.items()
        }
        beside = {name: (where, drawn[name][1]) for name, where in plan.others.items()}
        scene = draw_scene(self.config.scene, self.cameras, mesh, rng, plan.hands, beside)
        trajectory = plan.motion.plan(scene, self.steps(motion, index), rng)
        if tuple(trajectory.hands) != plan.hands:
            raise PluginError(
                f"motion {motion.name!r}: planned ways for {list(trajectory.hands)}, its spec names "
                f"{list(plan.hands)}"
            )
        require_known_objects(motion, scene, trajectory)
        scene = replace(scene, distractors=self._distractors(scene, trajectory, child(rng, "distractors")))
        looks = integer_seed(self.seed, "render", motion.name, index)
        shots = vary(rig.shots(scene, trajectory, looks), self._variants)
        kinds = {name: choice for name, (choice, _) in drawn.items()}
        return Take(primitive, scene, trajectory, shots, kinds)

    def sample(self, motion: Choice, index: int) -> Sample:
        """Make one episode as it is written; its frames are drawn while it is written. See `stage`."""
        take = self.stage(motion, index)
        header, pose = self._header_and_pose(take, motion, index)
        blocks = {name: self._blocks(shot) for name, shot in take.shots.items()}
        return Sample(header, pose, next_poses(pose), blocks, self.targets(take))

    def episode(self, motion: Choice, index: int) -> Episode:
        """Make one episode in memory; see `stage`."""
        take = self.stage(motion, index)
        header, pose = self._header_and_pose(take, motion, index)
        images = {
            name: frames.unpacked(self.frames, self.draw(shot), shot.view.width)
            for name, shot in take.shots.items()
        }
        return Episode(header, pose, next_poses(pose), images, self.targets(take))

    def targets(self, take: Take) -> NDArray[np.float32] | None:
        """(N, T) targets of an episode, or None where the config wants none; see `compute_targets`."""
        return compute_targets(take.trajectory, take.shots) if self.config.targets else None

    def draw(self, shot: Shot) -> NDArray[np.uint8]:
        """Draw a shot as the config's renderer does; see `geoprior.render.frames.draw`.

        Raises:
            PluginError: The renderer's frames are not what it says that it draws.
        """
        return frames.draw(self.renderer, shot, self.config.renderer.name)

    def recipe(self, motion: Choice) -> str:
        """See `recipe`."""
        return self._plan(motion).recipe

    def _draw_solid(self, choices: Sequence[Choice], rng: np.random.Generator) -> tuple[Choice, Mesh]:
        choice = choices[int(rng.integers(len(choices)))]
        return choice, self._primitive(choice).sample(rng)

    def _distractors(
        self, scene: Scene, trajectory: Trajectory, rng: np.random.Generator
    ) -> Sequence[SceneObject]:
        config = self.config.scene
        if config.distractors is None:
            return ()
        choices = config.distractors.primitives or self.config.primitives
        return draw_distractors(
            config.distractors,
            config.object.density,
            scene,
            trajectory,
            lambda: self._draw_solid(choices, rng)[1],
            rng,
        )

    def _primitive(self, choice: Choice) -> Primitive:
        key = choice.model_dump_json()
        if key not in self._primitives:
            self._primitives[key] = plugins().build("primitive", choice)
        return self._primitives[key]

    def _plan(self, motion: Choice) -> _Plan:
        key = motion.model_dump_json()
        if key not in self._plans:
            spec = cast("MotionSpec", plugins().spec("motion", motion.name))
            self._plans[key] = _Plan(
                plugins().build("motion", motion),
                recipe(self.config, self.cameras, self.seed, motion),
                hands_of(motion),
                others_of(spec, plugins().options("motion", motion)),
            )
        return self._plans[key]

    def _blocks(self, shot: Shot) -> Iterator[NDArray[np.uint8]]:
        frame = FrameFormat(self.frames, shot.view.height, shot.view.width)
        for steps in block_slices(shot.steps, math.prod(frame.drawn_shape)):
            yield self.draw(shot.at(steps))

    def _header_and_pose(
        self, take: Take, motion: Choice, index: int
    ) -> tuple[EpisodeHeader, NDArray[np.float32]]:
        config = self.config
        pose = take.trajectory.pose()
        header = EpisodeHeader(
            key=f"{motion.name}-{index:06d}",
            source="synthetic",
            motion=motion.name,
            index=index,
            seed=self.seed,
            fps=config.fps,
            steps=len(pose),
            hands=list(take.trajectory.hands),
            cameras=_camera_headers(take, self.frames),
            targets=list(
                target_names(tuple(take.trajectory.hands), tuple(take.shots)) if config.targets else ()
            ),
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


def hands_of(motion: Choice) -> tuple[str, ...]:
    """Names of the hands that a motion moves, in pose order.

    Raises:
        ConfigError: The motion is unknown.
        PluginError: The motion's spec names no hands, one twice, or one like the fixed camera or its mount.
    """
    hands: tuple[str, ...] = plugins().spec("motion", motion.name).hands  # type: ignore[attr-defined]
    if not can_be_told_apart(hands, rig.THIRD):
        raise PluginError(
            f"motion {motion.name!r}: its spec names the hands {list(hands)}",
            f"name each hand once, and none {rig.THIRD!r} or {WORLD!r}",
        )
    return hands


def _require_same_hands(motions: Sequence[Choice]) -> None:
    first = motions[0]
    for motion in motions:
        if hands_of(motion) != hands_of(first):
            raise ConfigError(
                f"generate.motions: {first.name} moves {list(hands_of(first))} and {motion.name} "
                f"{list(hands_of(motion))}",
                "name motions that move the same hands; a policy learns one kind of pose vector",
            )


def steps_of(
    config: GenerateConfig, seed: int, motion: Choice, index: int, episodes: int | None = None
) -> int:
    """N, the time steps of one episode.

    Args:
        config: The data set's config.
        seed: Root seed.
        motion: The episode's motion.
        index: Its number within the motion.
        episodes: Of each motion in an epoch: an episode is as long as the one that has its place in the first
            epoch. None takes the config's.
    """
    if not isinstance(config.seconds, tuple):
        return config.steps
    rng = generator(seed, "duration", motion.name, index % (episodes or config.episodes))
    return round(config.fps * uniform(rng, config.seconds))


def next_poses(pose: NDArray[np.float32]) -> NDArray[np.float32]:
    """Actions (N, 8 x hands): the pose at the next step; the last repeats."""
    return np.concatenate([pose[1:], pose[-1:]])


def recipe(config: GenerateConfig, cameras: CamerasConfig, seed: int, motion: Choice) -> str:
    """SHA-256 of everything an episode of this motion is made from, its number aside.

    How many episodes there are, of which other motions, and how they are packed does not enter.
    """
    made_from = recipe_tree(config, frozenset({"episodes", "episodes_per_shard", "motions"}))
    options = recipe_tree(plugins().options("motion", motion))
    made_from |= {"motion": {"name": motion.name, **options}, "cameras": recipe_tree(cameras)}
    return sha256_json(made_from | {"seed": seed, "revision": REVISION})


def _named_variants(config: GenerateConfig) -> dict[str, list[str]]:
    return {"variants": [variant.name for variant in config.variants]} if config.variants else {}


def _camera_headers(take: Take, kind: FrameKind) -> list[CameraHeader]:
    scene = take.scene
    third = invert(scene.third_view.transforms_world_to_camera)
    headers = [_camera_header(rig.THIRD, kind, scene.third_view, WORLD, third)]
    headers += [
        _camera_header(name, kind, hand.view, name, hand.transform_camera_to_hand)
        for name, hand in scene.hands.items()
    ]
    return sorted(headers, key=lambda header: header.name)


def _camera_header(
    name: str, kind: FrameKind, view: View, mount: str, transform_camera_to_mount: NDArray[np.float64]
) -> CameraHeader:
    return CameraHeader(
        name=name,
        height=view.height,
        width=view.width,
        channels=3 if kind == "rgb" else 1,
        bits=8 if kind == "gray" else None,
        intrinsics=view.intrinsics.tolist(),
        mount=mount,
        transform_camera_to_mount=transform_camera_to_mount.tolist(),
    )


def _details(take: Take) -> dict[str, Any]:
    scene, target = take.scene, take.scene.object
    ways = ways_of_objects(scene, take.trajectory)
    details = {
        "primitive": {"name": take.primitive.name, **target.mesh.parameters},
        "object": _object_details(target, ways[OBJECT]),
        "floor": {"side": scene.floor.side, "height": scene.floor.height, "spacing": scene.floor.spacing},
        "hand_cube": next(iter(scene.hands.values())).cube,
        "marker": take.trajectory.marker_points is not None,
        "phases": [[name, len(list(steps))] for name, steps in groupby(take.trajectory.phases)],
    }
    others = {
        name: {
            "primitive": {"name": take.others[name].name, **other.mesh.parameters},
            **_object_details(other, ways[name]),
        }
        for name, other in scene.others.items()
    }
    setback = next(iter(scene.hands.values())).setback
    added = {"others": others, "hand_setback": setback}
    return details | {name: value for name, value in added.items() if value}


def _object_details(drawn: SceneObject, way: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "extents": extents(drawn.mesh).tolist(),
        "position": drawn.centre.tolist(),
        "yaw": drawn.yaw,
        "final_position": way.reshape(-1, 4, 4)[-1, :3, 3].tolist(),
    }
