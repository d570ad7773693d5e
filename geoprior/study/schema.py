"""What ``results.json`` holds. Rates and differences are fractions, never percent; no timings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, ValidationError

from geoprior.errors import DataError
from geoprior.options import Options


class Bounds(Options):
    """A confidence interval."""

    low: float = Field(description="Lower end.")
    high: float = Field(description="Upper end.")


class CheckpointResult(Options):
    """Trials of one condition at one checkpoint."""

    epoch: int = Field(ge=0, description="Fine-tuning epochs.")
    trials: int = Field(ge=1, description="Rollouts, over all training seeds.")
    successes: int = Field(ge=0, description="Rollouts that did the task.")
    rate: float = Field(ge=0, le=1, description="successes / trials.")
    interval: Bounds = Field(description="Wilson score interval of the rate.")
    successes_by_training_seed: dict[str, int] = Field(description="Successes of each training seed.")
    failure_reasons: dict[str, int] = Field(description="How often each reason ended a failed rollout.")


class PeakResult(Options):
    """The best checkpoint in hindsight: it reads high and ranks nothing."""

    epoch: int = Field(ge=0, description="Of the best checkpoint, the earliest of equals.")
    rate: float = Field(ge=0, le=1, description="Its success rate.")
    expected_if_flat: float = Field(
        ge=0,
        le=1,
        description="What the peak would read on average if every checkpoint had the area's success rate.",
    )


class ConditionResult(Options):
    """One condition: the curve, and three ways to put it into one number."""

    name: str = Field(description="For example `prior` or `scratch`.")
    checkpoints: list[CheckpointResult] = Field(min_length=1, description="By rising epoch.")
    last_checkpoint: CheckpointResult = Field(description="The rule fixed in advance.")
    area_under_curve: float = Field(
        ge=0, le=1, description="Mean success rate from the first to the last checkpoint (trapezoids)."
    )
    peak: PeakResult = Field(description="The best checkpoint in hindsight.")


class Difference(Options):
    """A paired difference, condition minus baseline, on the same initial states."""

    difference: float = Field(ge=-1, le=1, description="Mean over all pairs.")
    interval: Bounds = Field(description="Bootstrap over training seeds and initial states.")


class CheckpointDifference(Difference):
    """The paired difference at one checkpoint."""

    epoch: int = Field(ge=0, description="Fine-tuning epochs of both.")
    pairs: int = Field(ge=1, description="Initial states x training seeds.")
    condition_only: int = Field(ge=0, description="Pairs in which only the condition succeeded.")
    baseline_only: int = Field(ge=0, description="Pairs in which only the baseline succeeded.")
    mcnemar_p: float = Field(
        ge=0, le=1, description="Exact McNemar test; it takes the trained policies as given."
    )


class Comparison(Options):
    """A condition against the baseline."""

    condition: str = Field(description="The condition.")
    baseline: str = Field(description="What it is compared with.")
    checkpoints: list[CheckpointDifference] = Field(min_length=1, description="At every shared epoch.")
    area_under_curve: Difference = Field(description="Of the areas over the shared epochs.")


Control = Literal["blind", "statistics", "other"]
"""What a condition tells of the prior's gain: what a prior without sight has of it, what the prior's
statistics alone have, or nothing in particular."""


class GainShare(Options):
    """What a condition has of the prior's gain over the baseline."""

    condition: str = Field(description="The condition.")
    control: Control = Field(
        description="`blind`: from a prior trained on black images; `statistics`: from random weights with "
        "the prior's statistics; `other`: any other, the prior among them."
    )
    reference: str = Field(description="The condition whose gain is shared out.")
    baseline: str = Field(description="What both are compared with.")
    area_under_curve: float = Field(
        ge=0, le=1, description="Of the condition, over the epochs that all three have."
    )
    gain: Difference = Field(description="Of that area over the baseline's.")
    share: float | None = Field(
        description="Its gain over the reference's: 1 for the reference, 0 for the baseline; null where the "
        "reference's gain is not clearly above zero."
    )
    interval: Bounds | None = Field(
        description="Of the share; null where the reference's gain is too uncertain to divide by."
    )


class GroupResult(Options):
    """Everything measured on one robot and task, in one look."""

    robot: str = Field(description="Registered name.")
    task: str = Field(description="Registered name.")
    look: str = Field("plain", description="Registered name.")
    training_seeds: list[int] = Field(min_length=1, description="Seeds of the trainings.")
    initial_states: int = Field(ge=1, description="Different initial states met.")
    conditions: list[ConditionResult] = Field(min_length=1, description="The baseline last.")
    comparisons: list[Comparison] = Field(description="Every other condition against the baseline.")
    gain_shares: list[GainShare] = Field(
        default=[],
        description="The prior first; empty where there are no conditions beside prior and baseline.",
    )


class Results(Options):
    """The content of ``results.json``: a pure function of the trials and the root seed."""

    schema_version: Literal[1] = 1
    confidence: float = Field(gt=0, lt=1, description="Of every interval.")
    bootstrap_samples: int = Field(ge=1, description="Resamples behind every paired interval.")
    groups: list[GroupResult] = Field(min_length=1, description="By robot, task and look.")


def parse_results(value: Mapping[str, Any], where: str = "results.json") -> Results:
    """Check what was read from ``results.json``.

    Raises:
        DataError: It is not what this version writes; the message names the key.
    """
    try:
        return Results.model_validate(value)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"])
        raise DataError(
            f"{where}: key {key!r}: {fault['msg']}", "run `geoprior report` on the run folder again"
        ) from error
