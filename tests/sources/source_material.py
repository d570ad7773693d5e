"""A data set of seconds, on disk and without end."""

import numpy as np
import torch

from geoprior.executors.local import SerialExecutor
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.normalise import Normaliser
from geoprior.sources.source import SourceContext
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.training.config import TrainConfig
from geoprior.training.data import Batches, features_of, statistics_of

SEED = 11
GENERATE = GenerateConfig(episodes=3, seconds=2, motions=["pick", "push"], episodes_per_shard=4)
CAMERAS = CamerasConfig(height=20, width=36)
"""A width that no whole number of bytes holds."""
SLOTS = 6


def write_shards(folder, config=GENERATE):
    generate(config, CAMERAS, seed=SEED, executor=SerialExecutor(), out=folder)
    return folder


def make_source(name, folder, *, config=GENERATE, cache_bytes=2**24, **options):
    context = SourceContext(folder, config, CAMERAS, SEED, cache_bytes)
    return plugins().build("source", Choice(name=name, options=options), context)


def make_batches(source, *, seed=0, **options):
    config = TrainConfig(**{"batch_size": 5, "prefetch": 0, "image_shift": 1, **options})
    return Batches(source, features_of(source, 4), Normaliser(statistics_of(source)), config, seed)


def same_batches(first, second):
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


def same_moments(first, second):
    pairs = [(first.pose, second.pose), (first.action, second.action)]
    assert first.frames.keys() == second.frames.keys()
    if first.targets is not None or second.targets is not None:
        pairs.append((first.targets, second.targets))
    pairs += [(frames, second.frames[camera]) for camera, frames in first.frames.items()]
    return all(a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype == np.float32) for a, b in pairs)


def read(source, numbers, times, chunk=3):
    """Moments with the actions of the next steps, which all lie inside the episodes."""
    return source.read(np.array(numbers), np.array(times)[:, None] + np.arange(chunk))
