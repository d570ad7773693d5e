"""A source: numbered episodes that never depend on what was read before."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoprior.authoring.conformance.check import Check, digest, require, require_array
from geoprior.episode import POSE_SIZE
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.types import SourceSpec
from geoprior.sources.source import SourceContext, targets_of
from geoprior.synthesis.config import GenerateConfig

if TYPE_CHECKING:
    from geoprior.sources.source import Source

GENERATE = GenerateConfig(fps=8.0, seconds=1.0, episodes=2, episodes_per_shard=4)
CAMERAS = CamerasConfig(height=24, width=32)
CACHE_BYTES = 2**20
LONGEST_CHUNK = 3


@contextmanager
def _opened(spec: SourceSpec, cache_bytes: int = 0) -> Iterator[Source]:
    """The source over a tiny data set that a generate stage could have written."""
    from geoprior.shards.manifest import write_manifest
    from geoprior.synthesis.generate import make_shard, plan_shards

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        write_manifest(out, [make_shard(task) for task in plan_shards(GENERATE, CAMERAS, 0, out)])
        context = SourceContext(out, GENERATE, CAMERAS, 0, cache_bytes)
        with closing(spec.factory(spec.config(), context)) as source:
            yield source


def says_what_it_holds(spec: SourceSpec) -> None:
    """Cameras, hands, size, rate and digest are of the kinds that training expects."""
    with _opened(spec) as source:
        where = f"source {spec.name!r}"
        require(len(source) >= 1, f"{where}: has no episodes", "`len(source)` counts the slots of an epoch")
        cameras = source.cameras
        require(
            isinstance(cameras, tuple) and list(cameras) == sorted(set(cameras)) and cameras,
            f"{where}: cameras are {cameras!r}",
            "give a tuple of names in alphabetical order",
        )
        hands = source.hands
        require(
            isinstance(hands, tuple) and len(set(hands)) == len(hands) > 0,
            f"{where}: hands are {hands!r}",
            "give a tuple of names, in the order of their parts of a pose",
        )
        height, width = source.image_size
        require(height >= 1 and width >= 1, f"{where}: image_size is {(height, width)}")
        require(source.fps > 0, f"{where}: fps is {source.fps}")
        require(
            len(source.digest) == 64 and set(source.digest) <= set("0123456789abcdef"),
            f"{where}: digest is {source.digest!r}",
            "give the SHA-256 of what decides its episodes, in hexadecimal digits",
        )


def poses_are_pose_vectors(spec: SourceSpec) -> None:
    """Each slot has poses and actions of as many steps, eight numbers a hand."""
    with _opened(spec) as source:
        for name, series in {"poses": source.poses, "actions": source.actions}.items():
            require(
                len(series) == len(source), f"source {spec.name!r}: {len(series)} {name}, {len(source)} slots"
            )
        size = POSE_SIZE * len(source.hands)
        for slot, (poses, actions) in enumerate(zip(source.poses, source.actions, strict=True)):
            where = f"source {spec.name!r}, slot {slot}"
            require_array(poses, f"{where}: poses", (None, size), np.float32)
            require_array(actions, f"{where}: actions", (len(poses), size), np.float32)
            norms = np.linalg.norm(poses.reshape(len(poses), -1, POSE_SIZE)[..., 3:7], axis=-1)
            require(np.abs(norms - 1.0).max() < 1e-3, f"{where}: a quaternion is not of unit length")


def moments_are_what_was_asked_for(spec: SourceSpec) -> None:
    """A read gives the pose, the actions and the frames of the steps in the episodes asked for."""
    with _opened(spec) as source:
        size, (height, width) = source.poses[0].shape[-1], source.image_size
        numbers, steps = _everything(source, LONGEST_CHUNK)
        moments = source.read(numbers, steps)
        where, count = f"source {spec.name!r}", len(numbers)
        require_array(moments.pose, f"{where}: pose", (count, size), np.float32)
        require_array(moments.action, f"{where}: action", (count, LONGEST_CHUNK, size), np.float32)
        names = targets_of(source)
        require(
            (moments.targets is not None) == bool(names),
            f"{where}: its attribute `targets` names {len(names)}, a read gives {moments.targets!r}",
            "name the targets that a read gives, or leave the attribute away",
        )
        if moments.targets is not None:
            require_array(moments.targets, f"{where}: targets", (count, len(names)), np.float32)
        require(
            set(moments.frames) == set(source.cameras),
            f"{where}: frames of {sorted(moments.frames)}, cameras {list(source.cameras)}",
        )
        for camera, frames in moments.frames.items():
            shape = (count, height, width) if np.ndim(frames) == 3 else (count, height, width, 3)
            require_array(frames, f"{where}: camera {camera!r}", shape, np.uint8)
        for row, (number, times) in enumerate(zip(numbers, steps, strict=True)):
            if number < len(source):
                expected = source.poses[number][times[0]], source.actions[number][times]
                require(
                    np.array_equal(moments.pose[row], expected[0])
                    and np.array_equal(moments.action[row], expected[1]),
                    f"{where}: number {number}, steps {times.tolist()}: a read gives other poses or actions "
                    "than `poses` and `actions` have",
                )


def reads_do_not_depend_on_each_other(spec: SourceSpec) -> None:
    """Read in one piece or one by one, in any order, with or without a cache: the same moments."""
    with _opened(spec) as source:
        numbers, steps = _everything(source, 1)
        whole = source.read(numbers, steps)
        first = source.digest
    with _opened(spec, CACHE_BYTES) as source:
        require(
            source.digest == first,
            f"source {spec.name!r}: another digest for the same data",
            "make the digest of what decides the episodes, and of nothing else",
        )
        for row in reversed(range(len(numbers))):
            alone = source.read(numbers[row : row + 1], steps[row : row + 1])
            same = digest(alone.pose) == digest(whole.pose[row : row + 1]) and all(
                np.array_equal(alone.frames[camera][0], whole.frames[camera][row]) for camera in whole.frames
            )
            require(
                same,
                f"source {spec.name!r}: number {numbers[row]} is another moment when it is read alone",
                "what a number stands for must not depend on what was read before",
            )


def may_be_closed_twice(spec: SourceSpec) -> None:
    """`close` can be called again."""
    with _opened(spec) as source:
        source.close()
        source.close()


def _everything(
    source: Source, chunk: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], np.ndarray[tuple[int, int], np.dtype[np.int64]]]:
    """Numbers (B,) and steps (B, chunk): moments of two epochs."""
    numbers = np.arange(2 * len(source), dtype=np.int64)
    lengths = np.array([len(source.poses[number % len(source)]) for number in numbers])
    first = (3 * numbers) % lengths
    steps = np.minimum(first[:, None] + np.arange(chunk), lengths[:, None] - 1)
    return numbers, steps.astype(np.int64)


CHECKS = (
    Check("it says what it holds", says_what_it_holds),
    Check("its poses are pose vectors", poses_are_pose_vectors),
    Check("a read gives what was asked for", moments_are_what_was_asked_for),
    Check("reads do not depend on each other", reads_do_not_depend_on_each_other),
    Check("it may be closed twice", may_be_closed_twice),
)
