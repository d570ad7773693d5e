"""What a user says about training. Light: nothing but pydantic is imported."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from geoprior.options import Choice, Options


class TrainConfig(Options):
    """What pretraining and fine-tuning share.

    An epoch is the paper's: one random time step of every episode. The optimiser takes
    ``ceil(epochs * episodes / batch_size)`` steps; a batch may span the border of two epochs.
    """

    speed_only = frozenset({"loader_workers", "prefetch", "frame_cache_mb", "resume_seconds", "log_every"})
    later = frozenset({"schedule", "final_rate", "average", "early"})

    epochs: int = Field(
        256, ge=1, le=10_000_000, description="Passes over the episodes, one time step of each."
    )
    batch_size: int = Field(64, ge=1, le=65_536, description="Samples of one optimiser step.")
    microbatches: int = Field(
        1,
        ge=1,
        le=4096,
        description="Equal parts in which a batch goes through the network, to save memory or to be shared "
        "out among the processes of torchrun. Batch norm sees one part at a time.",
    )
    learning_rate: float = Field(1e-4, gt=0.0, le=1.0, description="Of AdamW, after the warm-up.")
    trunk_learning_rate: float | None = Field(
        None, gt=0.0, le=1.0, description="Of the visual trunk; null takes `learning_rate`."
    )
    weight_decay: float = Field(1e-4, ge=0.0, le=1.0, description="Decoupled weight decay of AdamW.")
    gradient_clip: float | None = Field(
        None, gt=0.0, description="Largest L2 norm of the whole gradient; null does not clip."
    )
    warmup_steps: int = Field(
        0, ge=0, description="Steps over which the learning rate rises linearly from 0."
    )
    schedule: Literal["constant", "cosine"] = Field(
        "constant",
        description="The learning rate after the warm-up: `constant`, or a `cosine` that falls to "
        "`final_rate` at the end.",
    )
    final_rate: float = Field(
        0.0, ge=0.0, le=1.0, description="What `cosine` ends with, as a share of the full learning rate."
    )
    average: float = Field(
        0.0,
        ge=0.0,
        lt=1.0,
        description="Checkpoints hold an exponential moving average of the weights, of which each step "
        "leaves this share (0.995: some 200 steps); 0 saves the weights themselves.",
    )
    image_noise: float = Field(
        0.05, ge=0.0, le=1.0, description="Standard deviation of Gaussian noise on frames in [0, 1]."
    )
    image_shift: int = Field(
        0, ge=0, le=64, description="Frames are moved by up to so many pixels each way, edges repeated."
    )
    skip: int = Field(
        1, ge=1, le=1000, description="Every `skip`-th action: the policy's rate is the data's fps / skip."
    )
    early: float = Field(
        1.0,
        ge=1.0,
        le=4.0,
        description="Above 1, early time steps of an episode come more often: of N steps the one at floor(N "
        "u^early), u even in [0, 1); with 2, half of the samples are of the first quarter. There only "
        "the images tell what lies where; later the pose of the hand does, too.",
    )
    held_out: float = Field(
        0.0,
        ge=0.0,
        le=0.9,
        description="Share of the episodes that is not trained on, one at least if it is not 0; the loss on "
        "them is logged as `held_out_*` at every checkpoint.",
    )
    device: Literal["auto", "cpu", "cuda"] = Field(
        "auto", description="Where training runs; `auto` takes a GPU where torch finds one."
    )
    precision: Literal["auto", "bf16", "fp32"] = Field(
        "auto", description="`auto` times both on this machine; what was chosen stands in machine.json."
    )
    compile: bool = Field(
        default=False,
        description="Train through torch.compile, which takes minutes and a C++ compiler: it pays on GPUs.",
    )
    threads: int = Field(
        0,
        ge=0,
        le=1024,
        description="Threads of the arithmetic; 0 takes all usable cores, but 1 where a stage has several "
        "trainings to do on a CPU: those of one thread run side by side.",
    )
    loader_workers: int = Field(
        1,
        ge=0,
        le=64,
        description="Threads that prepare batches; 0: each when it is wanted. Never changes a result.",
    )
    prefetch: int = Field(
        2, ge=0, le=64, description="Batches prepared ahead by those threads; never changes a result."
    )
    frame_cache_mb: int = Field(
        256,
        ge=0,
        description="Memory for decoded frames or staged episodes, in MiB; never changes a result.",
    )
    checkpoint_every: int | None = Field(
        None, ge=1, description="Epochs between checkpoints; null writes only the one at the end."
    )
    resume_seconds: float = Field(
        60.0, ge=0.0, description="Least time between two saves of the state from which a killed run goes on."
    )
    log_every: int = Field(10, ge=1, description="Optimiser steps between two calls of the train-step hook.")

    @model_validator(mode="after")
    def _parts_are_equal(self) -> Self:
        if self.batch_size % self.microbatches:
            raise ValueError(f"microbatches {self.microbatches} must divide batch_size {self.batch_size}")
        return self

    @model_validator(mode="after")
    def _only_a_cosine_ends_lower(self) -> Self:
        if self.schedule == "constant" and self.final_rate:
            raise ValueError(f"final_rate {self.final_rate:g}: schedule is constant; set it to cosine")
        return self


END_FIELDS = ("until_vision_gain", "probe_episodes")
"""Of a pretraining: what decides when it ends, if a gain is wanted at all."""


class PretrainConfig(TrainConfig):
    """Training on the geometric data set."""

    later = TrainConfig.later | {"until_vision_gain"}
    speed_only = TrainConfig.speed_only | {"probe_episodes"}

    init: Literal["scratch", "imagenet"] = Field(
        "scratch",
        description="`scratch`: random weights; `imagenet`: a trunk trained on ImageNet, which torchvision "
        "fetches, the rest random.",
    )
    epochs: int = Field(
        128, ge=1, le=10_000_000, description="Passes over the episodes, one time step of each."
    )
    until_vision_gain: float | None = Field(
        None,
        gt=0.0,
        description="End at the first checkpoint whose `vision_gain` is as large, at the latest after "
        "`epochs`. A `cosine` falls over all `epochs` in any case.",
    )
    source: Choice = Field(
        default=Choice(name="shards"),
        description="Where the episodes come from: `shards` reads those that were generated, `endless` makes "
        "fresh ones while training.",
    )
    probe_episodes: int = Field(
        30,
        ge=0,
        le=100_000,
        description="Fresh episodes of each motion on which it is measured at every checkpoint whether the "
        "policy looks: `vision_gain` and what it is compared with; 0 does not. It changes no weights, "
        "only when `until_vision_gain` is reached.",
    )

    @field_validator("probe_episodes")
    @classmethod
    def _can_be_shuffled(cls, count: int) -> int:
        if count == 1:
            raise ValueError("one episode of a motion cannot get another one's images: two at least, or 0")
        return count

    @model_validator(mode="after")
    def _may_end_early(self) -> Self:
        if self.until_vision_gain is not None and self.checkpoint_every is None:
            raise ValueError("until_vision_gain: it is measured at checkpoints; set checkpoint_every")
        if self.until_vision_gain is not None and self.probe_episodes == 0:
            raise ValueError("until_vision_gain: with probe_episodes 0 nothing measures it; set it to 30")
        return self


class ConditionConfig(Options):
    """One way to begin fine-tuning."""

    later: ClassVar[frozenset[str]] = frozenset({"prior"})

    init: Literal["scratch", "prior", "blind-prior", "imagenet"] = Field(
        description="`scratch`: random weights; `prior`: those of the last checkpoint of pretraining; "
        "`blind-prior`: those of a second pretraining that is the same but for its images, all black; "
        "`imagenet`: a trunk trained on ImageNet, which torchvision fetches, the rest random."
    )
    weights: Literal["all", "trunk"] = Field(
        "all", description="Which of the prior's weights are taken; the rest begins at random."
    )
    statistics: Literal["pretrained", "new", "merged"] = Field(
        "new",
        description="Normalisation: of the prior, of the demonstrations, or of all time steps of both. "
        "Random weights may have the prior's too: a control that tells what normalisation alone brings.",
    )
    prior: str | None = Field(
        None,
        description="Another run's prior instead of this run's: a checkpoint, a folder of checkpoints or a "
        "run folder, of which the last checkpoint is taken. A relative path is one from the folder in which "
        "the command is given; the resolved config has it in full.",
    )

    @field_validator("prior")
    @classmethod
    def _say_in_full(cls, value: str | None) -> str | None:
        return None if value is None else str(Path(value).expanduser().absolute())

    @model_validator(mode="after")
    def _only_a_prior_gives(self) -> Self:
        if self.weights != "all" and not self.takes_weights:
            raise ValueError(f"init {self.init!r} has no prior to take weights from")
        if self.prior is not None and self.init == "blind-prior":
            raise ValueError("init 'blind-prior' is this run's own: use init 'prior' to name another run's")
        if self.prior is not None and not self.takes_from_a_prior:
            raise ValueError(
                f"init {self.init!r} with statistics 'new' takes nothing from the prior that is named"
            )
        return self

    @property
    def takes_weights(self) -> bool:
        """Whether it begins from a prior's weights."""
        return self.init in ("prior", "blind-prior")

    @property
    def takes_from_a_prior(self) -> bool:
        """Whether it needs a prior's checkpoint, for its weights or for its statistics."""
        return self.takes_weights or self.statistics != "new"


class FinetuneConfig(TrainConfig):
    """Training on the demonstrations, once for every condition and training seed."""

    checkpoint_every: int | None = Field(
        128, ge=1, description="Epochs between checkpoints; null writes only the one at the end."
    )
    conditions: dict[str, ConditionConfig] = Field(
        default={"scratch": ConditionConfig(init="scratch"), "prior": ConditionConfig(init="prior")},
        min_length=1,
        description="The conditions to compare, by name.",
    )
    seeds: list[int] = Field(
        default=[0],
        min_length=1,
        description="Training seeds: first weights, order of samples and noise, alike in all conditions.",
    )

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        for name in self.conditions:
            if not name.replace("-", "").replace("_", "").isalnum() or not name.islower():
                raise ValueError(f"condition {name!r}: use lower-case letters, digits, - and _")
        if len(set(self.seeds)) != len(self.seeds) or min(self.seeds) < 0:
            raise ValueError(f"seeds {self.seeds}: each must be at least 0 and occur once")
        return self

    @property
    def wants_blind_prior(self) -> bool:
        """Whether a condition begins from a prior that was trained on black images."""
        return any(condition.init == "blind-prior" for condition in self.conditions.values())
