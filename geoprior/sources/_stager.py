"""Stages episodes by number, keeps them while they are wanted, and draws single moments of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.errors import PluginError
from geoprior.sources.source import Moments
from geoprior.synthesis.studio import Studio, next_poses

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from geoprior.episode import FrameKind
    from geoprior.geometry.camera import CamerasConfig
    from geoprior.render.clouds import Shot
    from geoprior.synthesis.config import GenerateConfig


@dataclass(frozen=True)
class StagerConfig:
    """What a stager is made from; goes to worker processes.

    Attributes:
        generate: What the episodes are.
        cameras: Lenses and size of the frames.
        seed: Root seed.
        cache_bytes: Memory for staged episodes.
        episodes: Of each motion in an epoch, so that a slot's episodes are of one length; None takes the
            config's.
    """

    generate: GenerateConfig
    cameras: CamerasConfig
    seed: int
    cache_bytes: int
    episodes: int | None = None


@dataclass(frozen=True)
class _Staged:
    episode: int
    pose: NDArray[np.float32]
    action: NDArray[np.float32]
    shots: Mapping[str, Shot]
    targets: NDArray[np.float32] | None
    bytes: int


class Stager:
    """Makes what is wanted of the episodes of one run.

    The episode of number ``e`` is the one that the generate stage would write in that place: motions take
    turns. The last episode of each slot is kept as far as the memory goes; one that is not kept is staged
    again, to the same bits.

    Raises:
        ConfigError: The config names an unknown plug-in or option.
    """

    def __init__(self, config: StagerConfig) -> None:
        self._studio = Studio(config.generate, config.cameras, config.seed, config.episodes)
        self._generate = config.generate
        self._room = config.cache_bytes
        self._kept: dict[int, _Staged] = {}

    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras of every episode."""
        return tuple(self._staged(0, 0).shots)

    def frames(self) -> FrameKind:
        """What the frames of `moments` are."""
        return self._studio.frames

    def trajectories(
        self, slots: Sequence[int], episodes: Sequence[int]
    ) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Poses and actions, (N, 8 x hands) each, of some slots' episodes.

        Raises:
            GeopriorError: An episode cannot be staged.
        """
        staged = [self._staged(slot, episode) for slot, episode in zip(slots, episodes, strict=True)]
        return [(one.pose, one.action) for one in staged]

    def moments(self, slots: Sequence[int], episodes: Sequence[int], steps: NDArray[np.int64]) -> Moments:
        """Draw one moment of each of some slots' episodes.

        Args:
            slots: B of them.
            episodes: What stands in them.
            steps: (B, C); see `geoprior.sources.source.Source.read`.

        Returns:
            Its frames are as the renderer draws them: binary ones are packed.

        Raises:
            GeopriorError: An episode cannot be staged or drawn.
        """
        staged = [self._staged(slot, episode) for slot, episode in zip(slots, episodes, strict=True)]
        times = steps[:, 0].tolist()
        return Moments(
            pose=np.stack([one.pose[time] for one, time in zip(staged, times, strict=True)]),
            action=np.stack([one.action[row] for one, row in zip(staged, steps, strict=True)]),
            frames={
                camera: np.concatenate(
                    [self._draw(one.shots[camera], time) for one, time in zip(staged, times, strict=True)]
                )
                for camera in staged[0].shots
            },
            targets=_targets(staged, times),
        )

    def _draw(self, shot: Shot, time: int) -> NDArray[np.uint8]:
        return self._studio.draw(shot.at(slice(time, time + 1)))

    def _staged(self, slot: int, episode: int) -> _Staged:
        kept = self._kept.get(slot)
        if kept is not None and kept.episode == episode:
            return kept
        staged = self._stage(episode)
        if kept is not None:  # its time is over
            self._room += self._kept.pop(slot).bytes
        if staged.bytes <= self._room:
            self._room -= staged.bytes
            self._kept[slot] = staged
        return staged

    def _stage(self, episode: int) -> _Staged:
        index, turn = divmod(episode, len(self._generate.motions))
        motion = self._generate.motions[turn]
        take = self._studio.stage(motion, index)
        pose = take.trajectory.pose()
        steps = self._studio.steps(motion, index)
        if len(pose) != steps:
            raise PluginError(
                f"motion {motion.name!r}: planned {len(pose)} time steps where {steps} were asked for",
                "mend the plug-in, or train on the source `shards`",
            )
        action = next_poses(pose)
        targets = self._studio.targets(take)
        size = (
            pose.nbytes + action.nbytes + _bytes_of(take.shots) + (0 if targets is None else targets.nbytes)
        )
        return _Staged(episode, pose, action, take.shots, targets, size)


def _targets(staged: Sequence[_Staged], times: Sequence[int]) -> NDArray[np.float32] | None:
    rows = [one.targets[time] for one, time in zip(staged, times, strict=True) if one.targets is not None]
    return np.stack(rows) if rows else None


def _bytes_of(shots: Mapping[str, Shot]) -> int:
    """Memory of the arrays, each counted once: the cameras share most."""
    arrays: list[NDArray[Any]] = [shot.view.transforms_world_to_camera for shot in shots.values()]
    for shot in shots.values():
        for cloud in shot.clouds:
            arrays += [cloud.points, cloud.transforms_cloud_to_world]
            if cloud.surface is not None:
                arrays += [cloud.surface.vertices, cloud.surface.faces]
    return sum({id(array): array.nbytes for array in arrays}.values())
