from __future__ import annotations

import shutil
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from scripted_predictors import CAMERAS, ROBOT, TASK, load

from geoprior.errors import DataError, MachineError
from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor
from geoprior.files import sha256_file
from geoprior.options import Choice
from geoprior.policies.checkpoint import CheckpointHeader, checkpoint_path, save_checkpoint
from geoprior.policies.normalise import FeatureStatistics
from geoprior.policies.policy import Features
from geoprior.sim import rollout
from geoprior.sim.config import EvaluateConfig
from geoprior.sim.records import read_records
from geoprior.sim.rollout import CheckpointRef, evaluate, find_checkpoints

CONFIG = EvaluateConfig(trials=2, first_state=500, time_limit=0.4, films=1, film_size=64, batch=1)
MOMENTS = FeatureStatistics((0.0,) * 8, (1.0,) * 8, 9)
HEADER = CheckpointHeader(
    policy=Choice(name="act"),
    features=Features(("hand", "third"), (64, 64), ("hand",), 4),
    fps=10.0,
    statistics={"pose": MOMENTS, "action": MOMENTS},
    epoch=64,
    step=8,
    details={},
)


def _refs(folder: Path, *stems: str) -> list[CheckpointRef]:
    return [
        CheckpointRef("prior" if stem == "expert" else "scratch", 0, epoch, folder / f"{stem}.safetensors")
        for epoch, stem in enumerate(stems, start=1)
    ]


def _evaluate(out: Path, refs, executor=None, config: EvaluateConfig = CONFIG, task=TASK):
    return evaluate(
        config,
        robot=ROBOT,
        task=task,
        cameras=CAMERAS,
        seed=0,
        checkpoints=refs,
        executor=executor or SerialExecutor(),
        out=out,
        load=load,
    )


class StopsAfter(SerialExecutor):
    """Interrupted after some trials."""

    def __init__(self, count: int) -> None:
        self.count = count

    def run(self, function, items):
        for number, result in enumerate(super().run(function, items)):
            if number == self.count:
                raise KeyboardInterrupt
            yield result


@pytest.fixture
def refs(env, tmp_path) -> list[CheckpointRef]:
    return _refs(tmp_path, "still", "nan", "expert")


def test_conditions_meet_the_same_states_and_films_show_the_last_checkpoints(refs, tmp_path):
    out = tmp_path / "run"
    facts = _evaluate(out, refs, config=CONFIG.model_copy(update={"time_limit": 6.0}))
    records = read_records(out / "rollouts.jsonl")
    assert facts == {"trials": 6, "successes": 2}
    assert records == sorted(records)
    by_epoch = {epoch: [r for r in records if r.epoch == epoch] for epoch in (1, 2, 3)}
    assert all([r.state_seed for r in rows] == [500, 501] for rows in by_epoch.values())
    assert [r.reason for r in by_epoch[1]] == ["time-out"] * 2
    assert [r.reason for r in by_epoch[2]] == ["NaN action"] * 2
    assert all(r.success and r.reason == "" for r in by_epoch[3])
    assert all(r.seconds == r.steps / 10 for r in records)
    films = sorted(r.film for r in records if r.film)
    assert films == [
        "films/prior-s0-epoch-000003-state-500.webm",
        "films/scratch-s0-epoch-000002-state-500.webm",
    ]
    assert all((out / film).stat().st_size > 0 for film in films)


def test_a_lost_film_is_drawn_again_and_no_other_trial_is_run(env, tmp_path):
    refs = _refs(tmp_path, "still", "silent")
    _evaluate(tmp_path, refs)
    before = {path: path.read_bytes() for path in [tmp_path / "rollouts.jsonl", *tmp_path.glob("films/*")]}
    lost = next(iter(sorted(tmp_path.glob("films/*"))))
    lost.unlink()
    _evaluate(tmp_path, refs, StopsAfter(1))
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.parametrize("count", [0, 1, 3])
def test_interrupted_evaluation_goes_on_to_the_same_bytes(env, tmp_path, count):
    refs = _refs(tmp_path, "still", "silent")
    _evaluate(tmp_path / "whole", refs)
    with pytest.raises(KeyboardInterrupt):
        _evaluate(tmp_path / "cut", refs, StopsAfter(count))
    path = tmp_path / "cut" / "rollouts.jsonl"
    assert len(read_records(path)) == count
    if count:
        path.write_bytes(path.read_bytes() + path.read_bytes()[:33])
    _evaluate(tmp_path / "cut", refs)
    assert path.read_bytes() == (tmp_path / "whole" / "rollouts.jsonl").read_bytes()
    _evaluate(tmp_path / "cut", refs, StopsAfter(0))


def test_records_of_another_evaluation_are_refused(env, tmp_path):
    refs = _refs(tmp_path, "still")
    _evaluate(tmp_path, refs)
    with pytest.raises(DataError, match="not wanted"):
        _evaluate(tmp_path, refs, config=CONFIG.model_copy(update={"first_state": 501}))


def test_records_of_other_weights_are_refused(env, tmp_path):
    """A fine-tuning done again has the same names, and nobody may take its old rollouts for new ones."""
    (ref,) = _refs(tmp_path, "still")
    _evaluate(tmp_path, [replace(ref, weights="0123456789abcdef")])
    assert {record.weights for record in read_records(tmp_path / "rollouts.jsonl")} == {"0123456789abcdef"}
    _evaluate(tmp_path, [replace(ref, weights="0123456789abcdef")], StopsAfter(0))
    with pytest.raises(
        DataError, match=r"of other weights \(0123456789abcdef\) than those of .*still"
    ) as caught:
        _evaluate(tmp_path, [replace(ref, weights="f" * 16)])
    assert "delete the file" in caught.value.hint


def test_killed_worker_is_a_fault_of_the_machine_and_the_same_call_goes_on(env, tmp_path):
    """One worker is killed as the out-of-memory killer does it: an error, no hang, the same records after."""
    steady, doomed = _refs(tmp_path, "still", "dies-once")
    _evaluate(tmp_path / "whole", [steady, doomed.__class__("scratch", 0, 2, tmp_path / "still.safetensors")])
    out, executor = tmp_path / "run", LocalExecutor(LocalConfig(workers=1))
    begun = time.monotonic()
    with pytest.raises(MachineError, match="worker process died"):
        _evaluate(out, [steady, doomed], executor)
    assert time.monotonic() - begun < 60.0
    kept = read_records(out / "rollouts.jsonl")
    assert [record.epoch for record in kept] == [1, 1]
    _evaluate(out, [steady, doomed], executor)
    whole = (tmp_path / "whole" / "rollouts.jsonl").read_bytes()
    assert (out / "rollouts.jsonl").read_bytes() == whole


def test_policy_at_a_rate_that_does_not_divide_the_physics_is_refused(env, tmp_path, monkeypatch):
    monkeypatch.setattr(type(load(Path("still"))), "fps", 30.0)
    rollout._predictor.cache_clear()
    with pytest.raises(Exception, match="30 times a second"):
        _evaluate(tmp_path, _refs(tmp_path, "still"))
    rollout._predictor.cache_clear()


def test_checkpoints_are_found_by_condition_and_seed(tmp_path):
    with pytest.raises(DataError, match="no checkpoints"):
        find_checkpoints(tmp_path)
    for name in ("scratch-s1", "prior-s0", "same-environment-s2", "notes"):
        folder = tmp_path / name
        folder.mkdir()
        save_checkpoint(checkpoint_path(folder, 64), {"a": torch.ones(2)}, HEADER)
    (tmp_path / "prior-s0" / "epoch-000128.safetensors").touch()
    found = [(ref.condition, ref.training_seed, ref.epoch) for ref in find_checkpoints(tmp_path)]
    assert found == [("prior", 0, 64), ("same-environment", 2, 64), ("scratch", 1, 64)]
    digest = sha256_file(checkpoint_path(tmp_path / "prior-s0", 64))
    assert {ref.weights for ref in find_checkpoints(tmp_path)} == {digest[:16]}
    shutil.rmtree(tmp_path / "prior-s0")
    assert len(find_checkpoints(tmp_path)) == 2


@pytest.mark.parametrize("batch", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_batches_workers_and_interruptions_do_not_show_in_the_records(env, tmp_path, batch):
    refs = _refs(tmp_path, "still", "silent")
    config = CONFIG.model_copy(update={"trials": 5, "batch": batch})
    _evaluate(tmp_path / "whole", refs, config=config)
    whole = (tmp_path / "whole" / "rollouts.jsonl").read_bytes()
    out = tmp_path / "cut"
    with pytest.raises(KeyboardInterrupt):
        _evaluate(out, refs, StopsAfter(1), config=config)
    kept = (out / "rollouts.jsonl").read_bytes().splitlines(keepends=True)
    (out / "rollouts.jsonl").write_bytes(b"".join(kept[::2]))
    _evaluate(out, refs, LocalExecutor(LocalConfig(workers=2)), config=config)
    assert (out / "rollouts.jsonl").read_bytes() == whole
    assert {record.reason for record in read_records(out / "rollouts.jsonl")} == {"time-out", "NaN action"}


def test_trials_of_one_group_have_rows_of_their_own():
    ref = CheckpointRef("scratch", 0, 1, Path("unused"))
    other = CheckpointRef("prior", 0, 1, Path("unused"))
    missing = [(which, state) for which in (ref, other) for state in (5, 6, 7, 8, 12)]
    groups = list(rollout._grouped(missing, 4))
    assert groups == [(which, states) for which in (ref, other) for states in ((5, 6, 7), (8,), (12,))]
    for _, states in groups:
        assert len({state % 4 for state in states}) == len(states)
