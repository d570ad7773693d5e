from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.generate import floor_of_shard, floor_of_shot
from benchmarks.making import make_apart, paper_config
from geoprior.geometry.camera import CamerasConfig
from geoprior.synthesis.generate import plan_shards
from geoprior.synthesis.studio import Studio


def test_a_data_set_made_apart_tells_time_size_and_memory():
    made = make_apart(3, 32, 32, seconds=0.2, executor="serial", watch_memory=True)
    assert made.seconds > 0.0
    assert made.bytes > 3 * 6 * 2 * 1024
    assert made.peak > 20 << 20


def test_the_papers_data_set_has_its_600_episodes_of_300_steps():
    config = paper_config(600)
    assert config.episodes * len(config.motions) == 600
    assert config.steps == 300


def test_the_floor_draws_and_encodes_the_very_frames_of_the_data_set(monkeypatch):
    config, cameras = paper_config(3, seconds=0.2), CamerasConfig(height=40, width=56)
    (task,) = plan_shards(config, cameras, 3, Path("unused"))
    seen = []
    monkeypatch.setattr("benchmarks.generate.encode_members", lambda frames, *_: seen.append(frames))
    assert floor_of_shard(task) > 0.0
    studio = Studio(config, cameras, 3)
    wanted = [
        np.concatenate(list(blocks))
        for motion, index in task.episodes
        for blocks in studio.sample(motion, index).frames.values()
    ]
    measured = seen[1:]  # the first one only loads the machine code
    assert len(measured) == len(wanted) == 6
    for one, other in zip(measured, wanted, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_floor_of_a_shot_grows_with_its_frames():
    studio = Studio(paper_config(3), CamerasConfig(height=64, width=64), 0)
    shot = studio.stage(studio.config.motions[0], 0).shots["hand"]
    short, long = (
        min(floor_of_shot(studio.renderer, part) for _ in range(20)) for part in (shot.at(slice(3)), shot)
    )
    assert long > 3.0 * short
