"""One demonstration, learned by heart: the whole path from recording to closed loop, nothing to generalise.

A sign, a frame, a rate or a normalisation that is wrong anywhere on it shows here.
"""

import pytest

from geoprior.config import load_config
from geoprior.executors.local import SerialExecutor
from geoprior.hooks.manager import plugins
from geoprior.shards.reader import EpisodeStore
from geoprior.sim.config import DemosConfig, EvaluateConfig
from geoprior.sim.demos import collect
from geoprior.sim.records import read_records
from geoprior.sim.rollout import ROLLOUTS, evaluate, find_checkpoints
from geoprior.training.config import ConditionConfig, FinetuneConfig
from geoprior.training.stages import finetune

STATE = 700_000
STEPS, BATCH = 500, 16


@pytest.mark.slow
@pytest.mark.parametrize("ensembling", [0.01, None])
def test_one_demonstration_learned_by_heart_succeeds_from_its_own_state(tmp_path, ensembling):
    config = load_config("lite", (), plugins())
    scene = {"robot": config.robot, "task": config.task, "cameras": config.cameras, "seed": 5}
    demos = DemosConfig(episodes=1, first_state=STATE)
    collect(demos, **scene, executor=SerialExecutor(), out=tmp_path / "demos")
    (key,) = [EpisodeStore(tmp_path / "demos").header(0).key]
    assert key.endswith("000000"), "the first attempt failed: take another state"

    tuning = FinetuneConfig(
        epochs=STEPS * BATCH,
        checkpoint_every=None,
        batch_size=BATCH,
        learning_rate=3e-4,
        warmup_steps=50,
        conditions={"scratch": ConditionConfig(init="scratch")},
    )
    folder = tmp_path / "checkpoints"
    finetune(tuning, policy=config.policy, seed=5, demos=tmp_path / "demos", prior=None, out=folder)

    trial = EvaluateConfig(trials=1, first_state=STATE, ensembling=ensembling, batch=1, films=0)
    checkpoints = find_checkpoints(folder)
    evaluate(trial, **scene, checkpoints=checkpoints, executor=SerialExecutor(), out=tmp_path)
    (record,) = read_records(tmp_path / ROLLOUTS)
    assert record.success, record
