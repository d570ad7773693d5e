"""The golden shard: two tiny hand-made episodes, kept in the repository so that the format cannot drift.

``python -m geoprior.shards.golden FOLDER`` writes it. Pixels and poses are integer patterns and exact
fractions, so that no library's rounding is in them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from geoprior.episode import POSE_SIZE, CameraHeader, Episode, EpisodeHeader
from geoprior.shards.manifest import Manifest, write_manifest
from geoprior.shards.writer import write_shard

ZLIB = "1.2.13"
"""The zlib with which the committed RGB frames were made; others may compress the same pixels differently."""

FILE = "golden-000000.tar"
STEPS, HEIGHT, WIDTH = 3, 16, 16
_EYE = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


def golden_episodes() -> Iterator[Episode]:
    """Two episodes of 3 steps, a binary camera ``hand`` and an RGB camera ``third``, 16 x 16 pixels."""
    for number, motion in enumerate(("pick", "push")):
        header = _header(motion, number)
        pose = _poses(number)
        action = np.concatenate([pose[1:], pose[-1:]])
        yield Episode(header, pose, action, {"hand": _binary(number), "third": _rgb(number)})


def write_golden(folder: Path) -> Manifest:
    """Write the golden shard and its manifest."""
    return write_manifest(folder, [write_shard(folder / FILE, golden_episodes())])


def _header(motion: str, number: int) -> EpisodeHeader:
    return EpisodeHeader(
        key=f"{motion}-{number:06d}",
        source="synthetic",
        motion=motion,
        index=number,
        seed=7,
        fps=10.0,
        steps=STEPS,
        hands=["hand"],
        cameras=[_camera("hand", 1, "hand"), _camera("third", 3, "world")],
        generator="geoprior golden 1",
        details={"primitive": {"name": "box", "size": [0.0625, 0.03125, 0.125]}},
    )


def _camera(name: str, channels: int, mount: str) -> CameraHeader:
    return CameraHeader.model_validate(
        {
            "name": name,
            "height": HEIGHT,
            "width": WIDTH,
            "channels": channels,
            "intrinsics": [[16.0, 0.0, 7.5], [0.0, 16.0, 7.5], [0.0, 0.0, 1.0]],
            "mount": mount,
            "transform_camera_to_mount": _EYE,
        }
    )


def _poses(number: int) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    poses = np.zeros((STEPS, POSE_SIZE), np.float32)
    poses[:, 0] = np.arange(STEPS) / 8 + number
    poses[:, 1] = -0.25
    poses[:, 2] = 0.5 - np.arange(STEPS) / 16
    poses[:, 3:7] = 0.5
    poses[-1, 7] = 1.0
    return poses


def _binary(number: int) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    step, row, column = np.ogrid[:STEPS, :HEIGHT, :WIDTH]
    return np.where((row + column + 3 * step + number) % 5 == 0, 255, 0).astype(np.uint8)


def _rgb(number: int) -> np.ndarray[tuple[int, int, int, int], np.dtype[np.uint8]]:
    step, row, column = np.ogrid[:STEPS, :HEIGHT, :WIDTH]
    red = np.broadcast_to(row * 16, (STEPS, HEIGHT, WIDTH))
    green = np.broadcast_to(column * 16, (STEPS, HEIGHT, WIDTH))
    blue = np.broadcast_to(step * 100 + number, (STEPS, HEIGHT, WIDTH))
    return np.stack([red, green, blue], axis=-1).astype(np.uint8)


if __name__ == "__main__":
    write_golden(Path(sys.argv[1]))
