"""THE contract: what an episode is, whether synthetic, simulated or imported.

Names, shapes and units are fixed here and nowhere else; shards/README.md says the same for readers in
other languages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self, get_args

import numpy as np
from pydantic import Field, model_validator

from geoprior.errors import DataError
from geoprior.options import Options

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from numpy.typing import NDArray

SCHEMA_VERSION: Literal[1] = 1
POSE_FIELDS = ("x", "y", "z", "qx", "qy", "qz", "qw", "gripper")
POSE_SIZE = len(POSE_FIELDS)
WORLD = "world"
"""Mount of a camera that rides on no hand."""
HAND_AXES, IMAGE_AXES = ("right", "up", "forward"), ("column", "row")
"""Last parts of a target's name: a point in a hand's frame, metres, or in an image, half-frames."""
FrameKind = Literal["binary", "gray", "rgb"]
"""Black and white, one bit a pixel; 256 levels of gray; red, green and blue with 256 levels each."""

KINDS: tuple[FrameKind, ...] = get_args(FrameKind)


class FrameFormat(NamedTuple):
    """The frames of one camera.

    Attributes:
        kind: See `FrameKind`.
        height: Rows in pixels.
        width: Columns in pixels.
    """

    kind: FrameKind
    height: int
    width: int

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a frame as it is read and trained on, uint8: (H, W), or (H, W, 3) of RGB."""
        return (self.height, self.width, 3) if self.kind == "rgb" else (self.height, self.width)

    @property
    def drawn_shape(self) -> tuple[int, ...]:
        """Of a frame as a renderer draws it, uint8: a binary one is packed, (H, ceil(W / 8))."""
        return (self.height, -(-self.width // 8)) if self.kind == "binary" else self.shape

    def __str__(self) -> str:
        return f"{self.kind} {self.height} x {self.width}"


_Three, _Four = Field(min_length=3, max_length=3), Field(min_length=4, max_length=4)
_ThreeRows = Annotated[list[Annotated[list[float], _Three]], _Three]
_FourRows = Annotated[list[Annotated[list[float], _Four]], _Four]


class CameraHeader(Options):
    """A camera of an episode."""

    name: str = Field(
        pattern=r"^[a-z0-9][a-z0-9_-]*$", description="Name of the view, for example `hand` or `third`."
    )
    height: int = Field(ge=1, le=65_535, description="Rows in pixels.")
    width: int = Field(ge=1, le=65_535, description="Columns in pixels.")
    channels: Literal[1, 3] = Field(description="1: binary (0 or 255), or gray; 3: RGB.")
    bits: Literal[1, 8] | None = Field(
        None, description="Of a pixel's channel; without it 1 of one channel and 8 of three."
    )
    intrinsics: _ThreeRows = Field(description="(3, 3) pinhole matrix in pixels.")
    mount: str = Field(description="`world` for a fixed camera, else the name of the hand it rides on.")
    transform_camera_to_mount: _FourRows = Field(
        description="(4, 4); the camera looks along +z, +x right, +y down; metres."
    )

    @property
    def frame_format(self) -> FrameFormat:
        """Kind and size of its frames."""
        if self.channels == 3:
            return FrameFormat("rgb", self.height, self.width)
        return FrameFormat("gray" if self.bits == 8 else "binary", self.height, self.width)

    @model_validator(mode="after")
    def _refuse_coloured_bits(self) -> Self:
        if (self.channels, self.bits) == (3, 1):
            raise ValueError("bits: a camera of 3 channels has 8 bits a channel")
        return self


class EpisodeHeader(Options):
    """The JSON member of a sample: everything about an episode that is not an array."""

    schema_version: Literal[1] = SCHEMA_VERSION
    key: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$", description="Name of the sample in the shard.")
    source: str = Field(description="`synthetic`, `simulated`, or the name of an importer.")
    motion: str = Field(description="Motion or task that the episode shows.")
    index: int = Field(ge=0, description="Number of the episode within its source and motion.")
    seed: int = Field(ge=0, description="Root seed, or the initial-state seed of a simulation.")
    fps: float = Field(gt=0, description="Time steps a second.")
    steps: int = Field(ge=1, description="N, the number of time steps.")
    hands: list[str] = Field(min_length=1, description="Names of the hands, in pose order.")
    cameras: list[CameraHeader] = Field(min_length=1, description="In alphabetical order of name.")
    targets: list[str] = Field(
        default_factory=list,
        description="Names of the numbers in `targets.npy`; without them it is not there.",
    )
    generator: str = Field(description="Program and version that made the episode.")
    details: dict[str, Any] = Field(
        default_factory=dict, description="Primitive, its parameters, robot, and the like."
    )


@dataclass(frozen=True)
class Episode:
    """One demonstration in memory.

    Attributes:
        header: See `EpisodeHeader`.
        pose: (N, 8 x hands) float32: where each hand is at step t. Per hand ``x, y, z`` in metres in
            the workspace frame (origin on the table's or floor's middle, z up), the quaternion
            ``qx, qy, qz, qw`` of the hand frame [right, up, forward] in the workspace frame, and
            ``gripper``: 0 open, 1 closed.
        action: (N, 8 x hands) float32: the pose commanded at step t, in the same terms. For synthetic
            data it is the pose at step t + 1 (the last one repeats).
        images: Per camera (N, H, W) uint8, of a binary camera with 0 and 255 only, or (N, H, W, 3) uint8
            RGB; top row first.
        targets: (N, T) float32, named by the header's `targets`, NaN where there is none; None without names.
    """

    header: EpisodeHeader
    pose: NDArray[np.float32]
    action: NDArray[np.float32]
    images: Mapping[str, NDArray[np.uint8]]
    targets: NDArray[np.float32] | None = None

    def validate(self) -> None:
        """Check the arrays against the header.

        Raises:
            DataError: A shape, a type or a value breaks the contract; the message names the field.
        """
        validate_poses(self.header, "pose", self.pose)
        validate_poses(self.header, "action", self.action)
        validate_targets(self.header, self.targets)
        names = [camera.name for camera in self.header.cameras]
        if names != sorted(set(names)) or set(names) != set(self.images):
            raise DataError(f"{self.header.key}: cameras {names} do not match images {sorted(self.images)}")
        for camera in self.header.cameras:
            _validate_images(self.header, camera, self.images[camera.name])


def can_be_told_apart(hands: Collection[str], fixed_camera: str) -> bool:
    """Whether there are hands, each with a name of its own that is not the fixed camera's or its mount's.

    A hand's camera bears the hand's name, and its mount is the hand.
    """
    return len(set(hands)) == len(hands) > 0 and not {fixed_camera, WORLD} & set(hands)


def validate_poses(header: EpisodeHeader, field: str, poses: NDArray[np.float32]) -> None:
    """Check shape, finiteness, unit quaternions, their continuity, and the gripper's two values.

    Raises:
        DataError: Naming the sample, the field and the first step at fault.
    """
    where = f"{header.key}.{field}"
    expected = (header.steps, POSE_SIZE * len(header.hands))
    if poses.shape != expected or poses.dtype != np.float32:
        raise DataError(f"{where}: expected float32 {expected}, found {poses.dtype} {poses.shape}")
    by_hand = poses.reshape(header.steps, len(header.hands), POSE_SIZE)
    _require(np.isfinite(by_hand).all(axis=(1, 2)), where, "a value is not finite")
    quaternions = by_hand[..., 3:7].astype(np.float64)
    norms = np.linalg.norm(quaternions, axis=-1)
    _require((abs(norms - 1.0) < 1e-4).all(axis=1), where, "a quaternion is not of unit length")
    dots = np.sum(quaternions[1:] * quaternions[:-1], axis=-1)
    _require((dots >= 0.0).all(axis=1), where, "a quaternion changes sign to the next step")
    gripper = by_hand[..., 7]
    _require(((gripper == 0.0) | (gripper == 1.0)).all(axis=1), where, "a gripper is not 0 or 1")


def validate_targets(header: EpisodeHeader, targets: NDArray[np.float32] | None) -> None:
    """Check that there are as many targets as names, each a number or NaN.

    Raises:
        DataError: Naming the sample and the first step at fault.
    """
    where = f"{header.key}.targets"
    if targets is None and not header.targets:
        return
    expected = (header.steps, len(header.targets))
    if targets is None or targets.shape != expected or targets.dtype != np.float32:
        found = "none" if targets is None else f"{targets.dtype} {targets.shape}"
        raise DataError(f"{where}: expected float32 {expected}, found {found}")
    _require(~np.isinf(targets).any(axis=1), where, "a value is infinite")


def _validate_images(header: EpisodeHeader, camera: CameraHeader, images: NDArray[np.uint8]) -> None:
    where = f"{header.key}.{camera.name}"
    frame = camera.frame_format.shape
    if images.shape != (header.steps, *frame) or images.dtype != np.uint8:
        raise DataError(
            f"{where}: expected uint8 {(header.steps, *frame)}, found {images.dtype} {images.shape}"
        )


def _require(steps_good: NDArray[np.bool_], where: str, fault: str) -> None:
    if not steps_good.all():
        raise DataError(f"{where}: {fault} (step {int(np.argmin(steps_good))})")
