"""The hooks, in the order of the data's way. A plug-in implements those it needs.

A register hook takes nothing and yields specs. No hook is called for every sample: factories are
called once, then there are plain calls.
"""

from __future__ import annotations

from collections.abc import Iterable

import pluggy

from geoprior.hooks.types import (
    ExecutorSpec,
    LookSpec,
    MotionSpec,
    PolicySpec,
    PrimitiveSpec,
    RendererSpec,
    RobotSpec,
    SourceSpec,
    StageEvent,
    TaskSpec,
    TrainStep,
    VariantSpec,
)

hookspec = pluggy.HookspecMarker("geoprior")


@hookspec
def geoprior_primitives() -> Iterable[PrimitiveSpec]:  # type: ignore[empty-body]
    """Families of solids for the synthetic scenes."""


@hookspec
def geoprior_motions() -> Iterable[MotionSpec]:  # type: ignore[empty-body]
    """Motions of the hand for the synthetic episodes."""


@hookspec
def geoprior_variants() -> Iterable[VariantSpec]:  # type: ignore[empty-body]
    """Ablations of the synthetic episodes: what the cameras no longer see."""


@hookspec
def geoprior_renderers() -> Iterable[RendererSpec]:  # type: ignore[empty-body]
    """Ways to draw the scene's points into a camera's frames."""


@hookspec
def geoprior_sources() -> Iterable[SourceSpec]:  # type: ignore[empty-body]
    """Where pretraining takes its episodes from."""


@hookspec
def geoprior_robots() -> Iterable[RobotSpec]:  # type: ignore[empty-body]
    """Arms with a gripper, and how their gripper frame maps to the hand frame."""


@hookspec
def geoprior_tasks() -> Iterable[TaskSpec]:  # type: ignore[empty-body]
    """Downstream tasks: environment, success rule, initial states and scripted expert."""


@hookspec
def geoprior_looks() -> Iterable[LookSpec]:  # type: ignore[empty-body]
    """Ways in which the simulated world may look, with the physics left alone."""


@hookspec
def geoprior_policies() -> Iterable[PolicySpec]:  # type: ignore[empty-body]
    """Policies to train."""


@hookspec
def geoprior_executors() -> Iterable[ExecutorSpec]:  # type: ignore[empty-body]
    """Engines that run independent pieces of work side by side."""


@hookspec
def geoprior_before_stage(event: StageEvent) -> None:
    """Called before a stage runs; not called when the stage is skipped."""


@hookspec
def geoprior_after_stage(event: StageEvent) -> None:
    """Called after a stage has finished and its record is on disk."""


@hookspec
def geoprior_stage_failed(event: StageEvent) -> None:
    """Called when a stage ends with an error or an interrupt."""


@hookspec
def geoprior_train_step(event: TrainStep) -> None:
    """Called every few optimiser steps with the training's scalars."""
