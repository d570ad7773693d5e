"""What a user may say about the geometric data set. Light: pydantic only."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from geoprior.options import Choice, Options
from geoprior.scene.config import SceneConfig
from geoprior.scene.ranges import SecondsOrRange

_MOTIONS = ("pick", "place", "push")
_PRIMITIVES = ("prism", "pyramid", "cylinder", "cone", "sphere", "truncated-pyramid", "truncated-cone")


class GenerateConfig(Options):
    """The geometric data set: how many episodes, of what, and how long."""

    later = frozenset({"targets"})

    fps: float = Field(10.0, gt=0.0, le=1000.0, description="Time steps a second.")
    seconds: SecondsOrRange = Field(
        10.0, description="Length of an episode: a number, or a range that each episode draws from."
    )
    episodes: int = Field(200, ge=1, le=10_000_000, description="Episodes of each motion.")
    motions: list[Choice] = Field(
        default=[Choice(name=name) for name in _MOTIONS],
        min_length=1,
        description="Motions, each name once; the order is that of the episodes in a shard.",
    )
    primitives: list[Choice] = Field(
        default=[Choice(name=name) for name in _PRIMITIVES],
        min_length=1,
        description="Solids, each as likely; name one twice, perhaps with other options, to see it more.",
    )
    variants: list[Choice] = Field(
        default=[], description="Ablations: what the cameras no longer see, applied in this order."
    )
    renderer: Choice = Field(default=Choice(name="points"), description="How frames are drawn.")
    scene: SceneConfig = Field(default=SceneConfig(), description="Floor, object, hand and cameras.")
    targets: bool = Field(
        default=False,
        description="Episodes also hold where object and marker are in each hand's frame and in each image, "
        "for policies that learn it on the side.",
    )
    episodes_per_shard: int = Field(
        30, ge=1, le=100_000, description="Samples in a shard; a worker makes a shard at a time."
    )

    @property
    def steps(self) -> int:
        """The time steps of the shortest episode: every one has at least so many."""
        return round(self.fps * (self.seconds[0] if isinstance(self.seconds, tuple) else self.seconds))

    @model_validator(mode="after")
    def _refuse_duplicate_motions(self) -> Self:
        names = [motion.name for motion in self.motions]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(
                f"motions: {', '.join(twice)} named twice; an episode's key is its motion and number"
            )
        return self

    @model_validator(mode="after")
    def _refuse_no_steps(self) -> Self:
        if self.steps < 2:
            raise ValueError(f"fps x seconds gives {self.steps} time steps; an episode needs two at least")
        return self
