"""What plug-ins yield: frozen specs, and the protocols of what their factories build.

Nothing heavy is imported here: a spec can be listed and its config validated without torch, mujoco or
robosuite. A factory imports what it needs when it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray
    from pydantic import BaseModel

    from geoprior.episode import FrameKind
    from geoprior.motions.trajectory import Trajectory
    from geoprior.policies.policy import Policy
    from geoprior.render.clouds import Shot
    from geoprior.scene.config import OtherConfig
    from geoprior.scene.mesh import Mesh
    from geoprior.scene.scene import Scene
    from geoprior.sim.looks.look import Look
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.tasks.task import Task
    from geoprior.sources.source import Source

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Spec:
    """One named thing that a plug-in offers.

    Attributes:
        name: What a config calls it: lower case, digits and dashes.
        summary: One line for `geoprior plugins list`.
        config: The pydantic model of its options, frozen and with ``extra="forbid"``.
        factory: Builds it from an instance of ``config``. Heavy imports belong inside.
    """

    kind: ClassVar[str] = "spec"

    name: str
    summary: str
    config: type[BaseModel]
    factory: Callable[..., Any]


class Primitive(Protocol):
    """A family of solids."""

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw one solid as a closed triangle mesh, in metres, in the object frame."""
        ...


class Motion(Protocol):
    """A way to move the hands of a scene, and perhaps the object with them."""

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan ``steps`` poses through the scene; the scene is not changed."""
        ...


class Variant(Protocol):
    """An ablation of the data: changes what the cameras see, and nothing else."""

    def change(self, shots: Mapping[str, Shot]) -> Mapping[str, Shot]:
        """Give the shots with other clouds.

        Args:
            shots: What each camera sees of an episode, by the camera's name.

        Returns:
            The same cameras, with the views, the steps and the seeds that they had: the episode's header
            tells the first two, and colours are drawn from the last.
        """
        ...


class Renderer(Protocol):
    """Turns what is before a camera into its frames. No clouds give frames of zeros, whatever is drawn."""

    @property
    def frames(self) -> FrameKind:
        """What it draws: ``"binary"``, ``"gray"`` or ``"rgb"``; the same for every shot."""
        ...

    def render(self, shot: Shot) -> NDArray[np.uint8]:
        """Draw the N frames of one camera.

        A frame follows from its own time step's transforms and from ``shot.seed`` alone: an episode is drawn
        some steps at a time, and a training on fresh episodes asks for single ones.

        Args:
            shot: The camera, and the bodies before it, each at rest or moving as one.

        Returns:
            uint8. Binary: (N, height, ceil(width / 8)), eight pixels a byte, 1 for white, the leftmost
            pixel in the highest bit; see `geoprior.render.packing.pack_frames`. Gray: (N, height, width).
            RGB: (N, height, width, 3).
        """
        ...


class Executor(Protocol):
    """Runs a function over many items, here or elsewhere."""

    def run(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[tuple[int, Result]]:
        """Yield ``(position in items, result)`` in the order of completion.

        The function and the items must be importable or picklable within one machine's trust; an
        exception of the function is raised here and cancels what has not begun.
        """
        ...


@dataclass(frozen=True)
class PrimitiveSpec(Spec):
    """``factory(config) -> Primitive``"""

    kind: ClassVar[str] = "primitive"
    factory: Callable[..., Primitive]


def no_others(config: BaseModel) -> Mapping[str, OtherConfig]:
    """The `MotionSpec.others` of a motion whose scenes have one object."""
    del config
    return {}


@dataclass(frozen=True)
class MotionSpec(Spec):
    """``factory(config) -> Motion``

    Attributes:
        hands: Names of the hands that the motion moves, in pose order; its scenes hold these. All motions of
            a data set move the same ones.
        others: Gives, for the motion's options, the further objects of its scenes by name, and where each
            rests. The names stand in `Scene.others`, `Trajectory.others` and `Cloud.body`.
    """

    kind: ClassVar[str] = "motion"
    factory: Callable[..., Motion]
    hands: tuple[str, ...] = ("hand",)
    others: Callable[[Any], Mapping[str, OtherConfig]] = no_others


@dataclass(frozen=True)
class VariantSpec(Spec):
    """``factory(config) -> Variant``"""

    kind: ClassVar[str] = "variant"
    factory: Callable[..., Variant]


@dataclass(frozen=True)
class RendererSpec(Spec):
    """``factory(config) -> Renderer``"""

    kind: ClassVar[str] = "renderer"
    factory: Callable[..., Renderer]


@dataclass(frozen=True)
class SourceSpec(Spec):
    """``factory(config, context) -> Source``; see `geoprior.sources.source`."""

    kind: ClassVar[str] = "source"
    factory: Callable[..., Source]


@dataclass(frozen=True)
class RobotSpec(Spec):
    """``factory(config) -> Robot``"""

    kind: ClassVar[str] = "robot"
    factory: Callable[..., Robot]


@dataclass(frozen=True)
class TaskSpec(Spec):
    """``factory(config) -> Task``"""

    kind: ClassVar[str] = "task"
    factory: Callable[..., Task]


@dataclass(frozen=True)
class LookSpec(Spec):
    """``factory(config) -> Look``"""

    kind: ClassVar[str] = "look"
    factory: Callable[..., Look]


@dataclass(frozen=True)
class PolicySpec(Spec):
    """``factory(config, features) -> Policy``, a `torch.nn.Module`; see `geoprior.policies.policy`."""

    kind: ClassVar[str] = "policy"
    factory: Callable[..., Policy]


@dataclass(frozen=True)
class ExecutorSpec(Spec):
    """``factory(config) -> Executor``"""

    kind: ClassVar[str] = "executor"
    factory: Callable[..., Executor]


@dataclass(frozen=True)
class StageEvent:
    """What the stage hooks are told.

    Attributes:
        stage: Name of the stage.
        folder: The run folder.
        fingerprint: Of the stage's config and inputs.
        seconds: Wall time that the stage took; 0 before it began.
        error: The error's text when it failed, else empty.
    """

    stage: str
    folder: Path
    fingerprint: str
    seconds: float = 0.0
    error: str = ""


@dataclass(frozen=True)
class TrainStep:
    """What loggers are told after an optimiser step.

    Attributes:
        run: Which training it is, for example ``pretrain`` or ``finetune/prior-s0``.
        step: Optimiser steps done, from 1.
        steps: Steps that the training will take.
        epoch: Passes over the episodes, each giving one random time step (the paper's unit).
        metrics: Named scalars of this step, for example ``loss``, ``l1``, ``kl``, ``learning_rate``.
        folder: Where the training writes.
    """

    run: str
    step: int
    steps: int
    epoch: float
    metrics: Mapping[str, float]
    folder: Path
