"""What a run says about demonstrations and rollouts. Light: loaded by `geoprior config show`."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from geoprior.options import Choice, Options

SIMULATION_RATE = 500
"""Physics steps a second, fixed by robosuite; a control rate divides it, or the control steps drift."""


_NINE_TASKS = ("pick", "place", "push", "pile", "door", "can", "stack", "close", "cable")


class CollectConfig(Options):
    """What any collection of scripted demonstrations is told."""

    attempts_per_episode: int = Field(
        3, ge=1, le=100, description="Attempts allowed for each demonstration wanted, over all of a task's."
    )
    control_rate: int = Field(10, ge=1, le=SIMULATION_RATE, description="Commands a second; divides 500.")

    @field_validator("control_rate")
    @classmethod
    def _divides(cls, rate: int) -> int:
        if SIMULATION_RATE % rate:
            raise ValueError(f"must divide {SIMULATION_RATE}: 10, 20, 25 and 50 do")
        return rate


class DemosConfig(CollectConfig):
    """Scripted demonstrations in simulation."""

    episodes: int = Field(20, ge=1, le=100_000, description="Successful demonstrations to collect.")
    first_state: int = Field(
        0, ge=0, lt=2**62, description="Initial-state seed of the first attempt; the next ones count on."
    )
    look: Choice = Field(default=Choice(name="plain"), description="How the world looks to the cameras.")

    @property
    def max_attempts(self) -> int:
        """Attempts allowed in all: the initial states from ``first_state`` on that may be used."""
        return self.episodes * self.attempts_per_episode


class SameEnvironmentConfig(CollectConfig):
    """Demonstrations of many tasks in simulation: the paper's other prior, learned where it is used."""

    robot: Choice = Field(default=Choice(name="ur5e"), description="The arm; the paper's is the UR.")
    tasks: list[Choice] = Field(
        default=[Choice(name=name) for name in _NINE_TASKS],
        min_length=1,
        description="Tasks, each name once; they share the episodes evenly.",
    )
    episodes: int = Field(600, ge=1, le=1_000_000, description="Successful demonstrations in all.")
    first_state: int = Field(
        10_000_000,
        ge=0,
        lt=2**62,
        description="Initial-state seed of every task's first attempt; the next ones count on.",
    )

    @property
    def max_attempts(self) -> int:
        """Initial states from ``first_state`` on that a task may use at most."""
        return -(-self.episodes // len(self.tasks)) * self.attempts_per_episode

    @model_validator(mode="after")
    def _refuse_a_share_of_nothing(self) -> Self:
        names = [task.name for task in self.tasks]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(
                f"tasks: {', '.join(twice)} named twice; an episode's key is its task and number"
            )
        if self.episodes < len(names):
            raise ValueError(f"episodes: {self.episodes} cannot be shared among {len(names)} tasks")
        return self


class EvaluateConfig(Options):
    """Rollouts of checkpoints on unseen initial states, the same ones for every checkpoint."""

    trials: int = Field(30, ge=1, le=100_000, description="Initial states, and so trials of each checkpoint.")
    first_state: int = Field(
        1_000_000,
        ge=0,
        lt=2**62,
        description="Initial-state seed of the first trial; the next ones count on.",
    )
    ensembling: float | None = Field(
        0.01,
        ge=-1.0,
        le=10.0,
        description="Temporal ensembling: a prediction of age rank i, 0 for the oldest, weighs "
        "exp(-ensembling * i). null: carry out chunks open-loop.",
    )
    execute: int = Field(
        8, ge=1, le=1000, description="Without ensembling: actions of a chunk before the policy looks again."
    )
    time_limit: float | None = Field(
        None, gt=0.0, le=600.0, description="Seconds that a trial may take; null takes the task's own limit."
    )
    look: Choice = Field(
        default=Choice(name="plain"),
        description="How the world looks to the cameras: perhaps not as in the demonstrations. Physics and "
        "initial states are the same in every look.",
    )
    batch: int = Field(
        4,
        ge=1,
        le=256,
        description="Trials that run side by side in a worker, so that the policy looks for all of them at "
        "once. Each has an environment of its own.",
    )
    precision: Literal["fp32", "bf16"] = Field(
        "fp32",
        description="Of the policy's arithmetic. `bf16` is faster for large policies on CPUs that have AMX; "
        "trials may end otherwise in it.",
    )
    films: int = Field(
        2, ge=0, le=100, description="Trials to film of every condition's last checkpoint, the first ones."
    )
    film_size: int = Field(
        192, ge=32, le=1024, multiple_of=2, description="Rows and columns of each of a film's views."
    )

    @property
    def states(self) -> range:
        """The initial-state seeds."""
        return range(self.first_state, self.first_state + self.trials)
