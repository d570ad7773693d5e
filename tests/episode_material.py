"""Small episodes of any layout."""

import numpy as np
import pytest

from geoprior.episode import CameraHeader, Episode, EpisodeHeader
from geoprior.shards.manifest import write_manifest
from geoprior.shards.writer import write_shard

BINARY_AND_RGB = (("hand", 10, 12, 1), ("third", 10, 12, 3))
"""Name, rows, columns, and 1, 3 or "gray" of each camera."""


def _camera(name, height, width, channels):
    return CameraHeader(
        name=name,
        height=height,
        width=width,
        channels=3 if channels == 3 else 1,
        bits=8 if channels == "gray" else None,
        intrinsics=np.eye(3).tolist(),
        mount="world",
        transform_camera_to_mount=np.eye(4).tolist(),
    )


def _poses(rng, steps, hands):
    quaternions = rng.normal(size=(1, hands, 4)) + 0.2 * rng.normal(size=(steps, hands, 4)).cumsum(axis=0)
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    for step in range(1, steps):
        dots = np.sum(quaternions[step] * quaternions[step - 1], axis=-1, keepdims=True)
        quaternions[step] *= np.where(dots < 0, -1.0, 1.0)
    position, gripper = rng.normal(size=(steps, hands, 3)), rng.integers(2, size=(steps, hands, 1))
    return np.concatenate([position, quaternions, gripper], axis=-1).reshape(steps, -1).astype(np.float32)


@pytest.fixture(scope="session")
def make_episode():
    """Make a valid episode with random content that depends on nothing but the arguments."""

    def make(index=0, *, steps=4, cameras=BINARY_AND_RGB, hands=("hand",), fps=10.0, motion="pick", **header):
        rng = np.random.default_rng(index)
        images = {}
        for name, height, width, channels in cameras:
            if channels == "gray":
                images[name] = rng.integers(256, size=(steps, height, width), dtype=np.uint8)
            elif channels == 1:
                images[name] = (rng.random((steps, height, width)) < 0.3).astype(np.uint8) * np.uint8(255)
            else:
                images[name] = rng.integers(256, size=(steps, height, width, 3), dtype=np.uint8)
        fields = {
            "key": f"{motion}-{index:06d}",
            "source": "synthetic",
            "motion": motion,
            "index": index,
            "seed": 3,
            "fps": fps,
            "steps": steps,
            "hands": list(hands),
            "cameras": [_camera(*camera) for camera in cameras],
            "generator": "test",
        }
        pose, action = _poses(rng, steps, len(hands)), _poses(rng, steps, len(hands))
        return Episode(EpisodeHeader(**(fields | header)), pose, action, images)

    return make


@pytest.fixture(scope="session")
def same():
    """Compare two episodes to the last bit."""

    def compare(one, other):
        assert one.header == other.header
        for ours, theirs in ((one.pose, other.pose), (one.action, other.action)):
            assert ours.dtype == theirs.dtype == np.float32
            np.testing.assert_array_equal(ours, theirs)
        assert list(one.images) == list(other.images)
        for name, ours in one.images.items():
            assert other.images[name].dtype == np.uint8
            np.testing.assert_array_equal(ours, other.images[name])

    return compare


@pytest.fixture
def make_folder(tmp_path, make_episode):
    """Write a data set of two shards with three and two episodes."""

    def make(name="data", **layout):
        folder = tmp_path / name
        shards = {"a-000000.tar": (0, 1, 2), "a-000001.tar": (3, 4)}
        records = [
            write_shard(folder / file, (make_episode(i, **layout) for i in indices))
            for file, indices in shards.items()
        ]
        write_manifest(folder, records)
        return folder

    return make
