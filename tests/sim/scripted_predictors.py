"""Predictors without a network, named as what they are, for the rollout tests. Importable by workers."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.policies.policy import Features
from geoprior.sim.config import EvaluateConfig
from geoprior.sim.environment import Environment
from geoprior.sim.trial import Outcome, Trial, run_trials
from geoprior.sim.workers import Setup, environment

SIZE = 64
ROBOT, TASK = Choice(name="ur5e"), Choice(name="pick")
CAMERAS = CamerasConfig(height=SIZE, width=SIZE)


class HoldStill:
    """Says the present pose, a chunk of it."""

    features = Features(cameras=("hand", "third"), image_size=(SIZE, SIZE), hands=("hand",), chunk=4)
    fps = 10.0

    def predict(self, pose: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
        assert sorted(images) == ["hand", "third"]
        assert all(frames.shape == (len(pose), SIZE, SIZE, 3) for frames in images.values())
        return np.repeat(pose[:, None], 4, axis=1)


class NotFinite(HoldStill):
    """Breaks down at the third look."""

    looks = 0

    def predict(self, pose: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
        self.looks += 1
        chunk = super().predict(pose, images)
        return chunk * np.float32("nan") if self.looks > 2 else chunk


class SaysNothing(HoldStill):
    """Not a number from the first look on."""

    def predict(self, pose: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
        return super().predict(pose, images) * np.float32("nan")


class Expert(HoldStill):
    """The scripted expert behind the face of a policy: it looks at the simulator, not at the observation."""

    commands: Iterator[np.ndarray]
    last: np.ndarray

    def __init__(self, env: Environment) -> None:
        self.env = env

    def predict(self, pose: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
        if self.env.seconds == 0.0:
            self.commands = self.env.expert(seed=0)
            self.last = pose[0]
        self.last = next(self.commands, self.last)
        return self.last[None, None]


def load(path: Path):
    """A predictor by the name of its file; ``dies-once`` kills its worker the first time it is loaded."""
    if path.stem == "dies-once" and not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if path.stem == "expert":
        return Expert(environment(Setup(ROBOT, TASK, CAMERAS), 10))
    kinds = {"still": HoldStill, "nan": NotFinite, "silent": SaysNothing}
    return kinds.get(path.stem, HoldStill)()


def run_trial(
    env: Environment,
    predictor: HoldStill,
    config: EvaluateConfig,
    state: int,
    on_step: Callable[[], None] | None = None,
) -> Outcome:
    """One trial alone."""
    trial = Trial(env, config, state, on_step)
    run_trials({0: trial}, predictor, rows=1)
    assert trial.outcome is not None
    return trial.outcome
