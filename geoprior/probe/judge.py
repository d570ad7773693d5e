"""Vision gain at the checkpoints of pretraining."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from geoprior.probe.baselines import lessons_of
from geoprior.probe.episodes import fresh_episodes
from geoprior.probe.sight import as_metrics
from geoprior.probe.vision import VisionProbe

if TYPE_CHECKING:
    from torch import nn

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.synthesis.config import GenerateConfig
    from geoprior.training.judge import Judge, Taught
    from geoprior.training.machine import Machine


@dataclass(frozen=True)
class VisionJudge:
    """See `geoprior.training.judge.Judge`: `geoprior.probe.sight.as_metrics` on fresh episodes.

    They are made at the first call: a training that is done before, or that another process leads, makes
    none.

    Attributes:
        generate: The recipe of the training's episodes.
        cameras: Of the same.
        seed: Root seed of the run.
        episodes: Of each motion, two at least.
        taught: What the training learns from.
    """

    generate: GenerateConfig
    cameras: CamerasConfig
    seed: int
    episodes: int
    taught: Taught = field(repr=False)

    def measure(self, policy: nn.Module, machine: Machine) -> dict[str, float]:
        """See `geoprior.training.judge.Judge.measure`.

        Raises:
            GeopriorError: An episode cannot be made.
        """
        return as_metrics(self._probe.measure(policy, machine))

    @cached_property
    def _probe(self) -> VisionProbe:
        taught = self.taught
        normaliser, skip = taught.normaliser, taught.skip
        poses, actions = (
            [numbers[slot] for slot in taught.slots]
            for numbers in (taught.source.poses, taught.source.actions)
        )
        lessons = lessons_of(poses, actions, normaliser, taught.features.chunk, skip)
        episodes = fresh_episodes(self.generate, self.cameras, self.seed, self.episodes)
        return VisionProbe(episodes, taught.features, normaliser, skip, lessons)


def make_vision_judge(
    generate: GenerateConfig, cameras: CamerasConfig, seed: int, episodes: int, taught: Taught
) -> Judge:
    """A `geoprior.training.judge.JudgeMaker`, once its first four arguments are given."""
    return VisionJudge(generate, cameras, seed, episodes, taught)
