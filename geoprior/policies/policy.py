"""What the trainer and the rollouts know of a policy: this and no more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, NotRequired, Protocol, TypedDict

from pydantic import Field

from geoprior.options import Options

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray
    from torch import Tensor


TrunkNorm = Literal["batch", "frozen", "group"]
"""Norms of `geoprior.policies.trunk.ResNet18`: trainable batch norm, one that stays as it is, group norm."""


ActionKind = Literal["absolute", "relative"]
"""How a policy says positions: in the workspace frame, or as what they differ from the present one."""


class PolicyOptions(Options):
    """What the trainer reads of every policy's options; a policy's config model derives from it."""

    later: ClassVar[frozenset[str]] = frozenset({"actions"})

    chunk: int = Field(25, ge=1, le=1000, description="Actions that one prediction holds.")
    actions: ActionKind = Field(
        "absolute",
        description="What is learned of the positions in a chunk: `absolute` ones, or how they differ from "
        "the present one, `relative`. Commands are absolute in any case; a prior must be of the same kind.",
    )

    @property
    def uses_targets(self) -> bool:
        """Whether such a policy learns, on the side, the targets of data that have some."""
        return False


@dataclass(frozen=True)
class Features:
    """What a policy sees and says.

    Attributes:
        cameras: Names in alphabetical order: the order never depends on a config's.
        image_size: (height, width) of every camera, in pixels.
        hands: Names, in the order of their parts of a pose.
        chunk: Actions that one prediction holds.
        targets: Names of what a pretraining learns on the side, in the order of a batch's; none for a policy
            that does not, on data without them, and of a checkpoint.
    """

    cameras: tuple[str, ...]
    image_size: tuple[int, int]
    hands: tuple[str, ...]
    chunk: int
    targets: tuple[str, ...] = ()

    @property
    def pose_size(self) -> int:
        """Numbers of a pose and of one action."""
        from geoprior.episode import POSE_SIZE  # this module is light: config models derive from it

        return POSE_SIZE * len(self.hands)


class Observation(TypedDict):
    """One batch of observations, normalised."""

    pose: Tensor
    """(B, pose_size)"""
    images: Tensor
    """(B, cameras, 3, H, W), cameras as in `Features`"""


class Batch(Observation):
    """One batch of training samples, normalised."""

    action: Tensor
    """(B, chunk, pose_size)"""
    valid: Tensor
    """(B, chunk) bool: false where the episode has ended and the action is padding"""
    targets: NotRequired[Tensor]
    """(B, T) of the names in `Features.targets`, where there are some; NaN where one is not known"""


class Policy(Protocol):
    """A `torch.nn.Module` that learns action chunks. Inputs and outputs are normalised.

    Attributes:
        features: As given to the factory.
        trunk_prefixes: How the names of the visual trunk's tensors begin in the state dict, for its own
            learning rate and for partial transfer.

    Two attributes more may be there. ``training_only_prefixes``, a tuple, says how the names of tensors begin
    that nothing of a prediction depends on: a checkpoint is without them. ``half_weights = True`` says that
    in bfloat16 on a CPU the large weights may be bfloat16 themselves, which saves rounding them at every
    step. It holds where all arithmetic with them is under the caller's autocast; a part with autocast
    switched off would meet two types.

    One method more may be there: ``trunk_features(images)``, from frames (B, cameras, 3, H, W) to what the
    visual trunk makes of each, (B, cameras, F) float32, without gradients: `geoprior probe` asks what can be
    read from it. `geoprior.policies.trunk.camera_features` is one.
    """

    features: Features
    trunk_prefixes: tuple[str, ...]

    def loss(self, batch: Batch) -> tuple[Tensor, Mapping[str, Tensor]]:
        """The scalar to minimise, and detached scalars to log (``l1`` among them)."""
        ...

    def predict(self, observation: Observation) -> Tensor:
        """(B, chunk, pose_size) actions, without gradients or randomness."""
        ...


class Predictor(Protocol):
    """A trained policy with its normalisation: raw observations in, raw action chunks out."""

    features: Features
    fps: float

    def predict(
        self, pose: NDArray[np.float32], images: Mapping[str, NDArray[np.uint8]]
    ) -> NDArray[np.float32]:
        """Predict one chunk for each of B observations.

        Args:
            pose: (B, pose_size), the episode contract's pose vectors.
            images: Per camera (B, H, W, 3) RGB or (B, H, W) binary or gray frames.

        Returns:
            (B, chunk, pose_size) pose commands at the policy's rate ``fps``, quaternions of unit length,
            gripper 0 or 1. A command that is not finite is NaN in all its numbers: it fails its own trial.
        """
        ...
