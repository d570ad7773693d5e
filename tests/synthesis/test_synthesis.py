"""An episode is a pure function of config, seed, motion and number: alone, in any order, in any process."""

from __future__ import annotations

import hashlib
import multiprocessing
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.shards import sample
from geoprior.shards.writer import write_samples, write_shard
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio, synthesise

MOTIONS = ("pick", "place", "push")
EPISODES = [(motion, index) for motion in MOTIONS for index in (0, 1, 7, 199)]
CAMERAS = CamerasConfig(height=33, width=47)
CONFIG = GenerateConfig(fps=6, seconds=1.0)


def fingerprint(folder, motion, index, config=CONFIG, seed=3):
    """SHA-256 of a shard that holds this episode alone: header, poses, actions and every frame."""
    path = folder / f"{motion}-{index}-{os.getpid()}.tar"
    write_shard(path, [synthesise(config, CAMERAS, seed, Choice(name=motion), index)])
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("alone")


@pytest.fixture(scope="module")
def expected(folder):
    return {episode: fingerprint(folder, *episode) for episode in EPISODES}


def batched_fingerprint(folder, studio, motion, index):
    """The same of an episode that a studio makes among others, drawing its frames while they are written."""
    path = folder / f"{motion}-{index}-{os.getpid()}.tar"
    write_samples(path, [studio.sample(Choice(name=motion), index)])
    return hashlib.sha256(path.read_bytes()).hexdigest()


@settings(max_examples=12, deadline=None)
@given(st.permutations(EPISODES))
def test_the_same_from_a_studio_that_makes_many_in_any_order(folder, expected, order):
    studio = Studio(CONFIG, CAMERAS, 3)
    for episode in order:
        assert batched_fingerprint(folder, studio, *episode) == expected[episode]


@pytest.mark.parametrize("frames", [1, 4])
def test_the_same_where_frames_are_drawn_in_several_blocks(folder, expected, monkeypatch, frames):
    frame_bytes = 33 * 6
    monkeypatch.setattr(sample, "_BLOCK_BYTES", frames * frame_bytes)
    assert len(list(sample.block_slices(6, frame_bytes))) == -(-6 // frames)
    studio = Studio(CONFIG, CAMERAS, 3)
    for episode in EPISODES:
        assert batched_fingerprint(folder, studio, *episode) == expected[episode]


@settings(max_examples=12, deadline=None)
@given(st.permutations(EPISODES), st.integers(0, 2**32 - 1))
def test_the_same_in_any_order_whatever_the_global_generator_does(folder, expected, order, other):
    before = np.random.get_state()  # noqa: NPY002
    for episode in order:
        np.random.seed(other)  # noqa: NPY002
        assert fingerprint(folder, *episode) == expected[episode]
    np.random.set_state(before)  # noqa: NPY002


def test_the_same_in_spawned_processes(folder, expected):
    backwards = EPISODES[::-1]
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        found = pool.starmap(fingerprint, [(folder, *episode) for episode in backwards], chunksize=1)
    assert dict(zip(backwards, found, strict=True)) == expected


def test_the_same_whatever_else_the_data_set_holds(folder, expected):
    for motion, index in EPISODES:
        alone = {"episodes": 200, "episodes_per_shard": 4, "motions": [Choice(name=motion)]}
        assert fingerprint(folder, motion, index, CONFIG.model_copy(update=alone)) == expected[motion, index]


def test_seed_motion_and_number_all_matter(folder, expected):
    others = {fingerprint(folder, *episode, seed=4) for episode in EPISODES}
    assert len(others | set(expected.values())) == 2 * len(EPISODES)
    poses = [synthesise(CONFIG, CAMERAS, 3, Choice(name=motion), index).pose for motion, index in EPISODES]
    assert len({pose.tobytes() for pose in poses}) == len(EPISODES), "not in the headers alone"
