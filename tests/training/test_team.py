"""Trainings by several processes: real torchrun, real gloo, the command line as a user types it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
import torch
from training_material import make_training

from geoprior.errors import ConfigError, DataError
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.training.loop import fit
from geoprior.training.team import Team, team

TINY = (
    "cameras={height: 32, width: 32}",
    "generate.episodes=3",
    "generate.seconds=2",
    "generate.episodes_per_shard=4",
    "policy={name: act, chunk: 4, dim: 16, heads: 2, ffn: 16, vae_layers: 1, latent: 4, trunk_width: 8}",
    "pretrain.epochs=12",
    "pretrain.batch_size=4",
    "pretrain.microbatches=2",
    "pretrain.warmup_steps=0",
    "pretrain.precision=fp32",
    "pretrain.threads=1",
    "pretrain.log_every=1",
    "pretrain.resume_seconds=0",
    "executor=serial",
)  # fmt: skip
TORCHRUN = ("-m", "torch.distributed.run", "--nproc-per-node=2", "--standalone", "-m", "geoprior")


def _command(launcher: tuple[str, ...], stage: str, out: Path, *more: str) -> list[str]:
    options = [word for setting in (*TINY, *more) for word in ("--set", setting)]
    return [sys.executable, *launcher, stage, "lite", "--out", str(out), *options]


def _run(launcher: tuple[str, ...], stage: str, out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    command = _command(launcher, stage, out, *more)
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=300, start_new_session=True
    )


def _log(out: Path) -> list[dict[str, float]]:
    lines = (out / "checkpoints" / "pretrain" / "log.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


def _weights(out: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(list_checkpoints(out / "checkpoints" / "pretrain")[-1].path)[1]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The data, and a pretraining by one process."""
    out = tmp_path_factory.mktemp("alone") / "run"
    for stage in ("generate", "pretrain"):
        done = _run(("-m", "geoprior"), stage, out)
        assert done.returncode == 0, done.stderr
    return out


def test_two_processes_train_as_one_does(alone, tmp_path):
    out = tmp_path / "run"
    assert _run(("-m", "geoprior"), "generate", out).returncode == 0
    done = _run(TORCHRUN, "pretrain", out)
    assert done.returncode == 0, done.stderr
    mine, theirs = _log(out), _log(alone)
    assert [line["step"] for line in mine] == [line["step"] for line in theirs] == list(range(1, 28))
    np.testing.assert_allclose([line["loss"] for line in mine], [line["loss"] for line in theirs], atol=1e-4)
    assert mine[-1]["loss"] != mine[0]["loss"]
    weights = _weights(out)
    for name, tensor in _weights(alone).items():
        torch.testing.assert_close(weights[name], tensor, atol=1e-3, rtol=1e-3, msg=name)
    again = _run(TORCHRUN, "pretrain", out)
    assert again.returncode == 0, again.stderr
    assert "pretrain: done before, skipped" in again.stderr


@pytest.mark.slow
def test_killed_while_two_train_it_goes_on_to_the_same_losses(alone, tmp_path):
    out = tmp_path / "run"
    assert _run(("-m", "geoprior"), "generate", out).returncode == 0
    process = subprocess.Popen(
        _command(TORCHRUN, "pretrain", out), start_new_session=True, stderr=subprocess.DEVNULL
    )
    log = out / "checkpoints" / "pretrain" / "log.jsonl"
    deadline = time.monotonic() + 200.0
    while not (log.exists() and len(log.read_text().splitlines()) >= 5):
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()  # torchrun alone: its workers must not wait for it, nor for each other
    process.wait()
    while subprocess.run(["pgrep", "-f", str(out)], capture_output=True, check=False).returncode == 0:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    done = _run(TORCHRUN, "pretrain", out)
    assert done.returncode == 0, done.stderr
    found = [line["loss"] for line in _log(out)]
    np.testing.assert_allclose(found, [line["loss"] for line in _log(alone)], atol=1e-4)


def test_processes_that_cannot_share_a_batch_end_with_a_sentence(alone, tmp_path):
    out = tmp_path / "run"
    shutil.copytree(alone, out)
    command = [*_command(TORCHRUN, "pretrain", out, "pretrain.microbatches=1"), "--replace"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode != 0
    assert "error: 2 processes cannot share 1 microbatches evenly" in done.stderr  # torchrun adds its own


def test_a_batch_in_parts_goes_through_the_same_samples(fake_store, tmp_path):
    """Without noise the samples are those of the whole batch, and nobody reads one twice."""
    whole = make_training(fake_store, tmp_path / "a", batch_size=6, image_noise=0.0)
    parts = make_training(fake_store, tmp_path / "b", batch_size=6, image_noise=0.0, microbatches=3)
    for step in range(4):
        together = torch.cat([parts.batches.batch(step, part)["pose"] for part in range(3)])
        assert torch.equal(together, whole.batches.batch(step)["pose"])


def test_parts_leave_running_statistics_at_their_mean(fake_store, tmp_path):
    training = make_training(fake_store, tmp_path, batch_size=4, microbatches=2, epochs=1)
    policy = training.policy
    policy.norm = torch.nn.BatchNorm1d(8)
    inner = policy.loss

    def loss(batch):
        seen.append(batch["pose"].mean(0))
        policy.norm(batch["pose"])
        return inner(batch)

    seen: list[torch.Tensor] = []
    policy.loss = loss
    fit(training)
    expected = torch.zeros(8)
    for first, second in zip(seen[::2], seen[1::2], strict=True):
        expected = 0.9 * expected + 0.1 * (first + second) / 2.0
    torch.testing.assert_close(policy.norm.running_mean, expected, atol=1e-6, rtol=1e-5)
    assert int(policy.norm.num_batches_tracked) == training.steps


@pytest.mark.parametrize(("size", "microbatches"), [(2, 1), (3, 4), (4, 2)])
def test_uneven_shares_are_refused(size, microbatches):
    with pytest.raises(ConfigError, match=f"{size} processes cannot share {microbatches}"):
        Team(0, size, size).share_of(microbatches)


@pytest.mark.parametrize(("size", "microbatches"), [(1, 1), (2, 2), (2, 6), (4, 8)])
def test_every_part_is_somebodys_and_no_two_have_the_same(size, microbatches):
    shares = [list(Team(rank, size, size).share_of(microbatches)) for rank in range(size)]
    assert list(chain(*shares)) == list(range(microbatches))


def test_microbatches_divide_the_batch():
    with pytest.raises(ValueError, match="must divide batch_size"):
        make_training(None, Path("unused"), batch_size=3, microbatches=2)


def test_constants_stay_what_they_are_to_the_last_bit(fake_store, tmp_path):
    """A third of most numbers is no float: three of them make another number."""
    training = make_training(fake_store, tmp_path, batch_size=6, microbatches=3, epochs=2)
    constants = torch.rand(10_000, generator=torch.Generator().manual_seed(0))
    training.policy.register_buffer("constants", constants.clone(), persistent=False)
    fit(training)
    assert torch.equal(training.policy.constants, constants)


def test_a_buffer_of_infinities_stays_one(fake_store, tmp_path):
    """A causal mask is one."""
    training = make_training(fake_store, tmp_path, batch_size=6, microbatches=3, epochs=1)
    mask = torch.full((4, 4), -torch.inf).triu(1)
    training.policy.register_buffer("mask", mask.clone())
    fit(training)
    assert torch.equal(training.policy.mask, mask)


class FollowerElsewhere(Team):
    """A process of a team whose first one is at another step."""

    def agree(self, decide):
        mine = decide()
        return mine if mine is None else mine + 4


def test_processes_that_find_other_states_do_not_train_together(fake_store, tmp_path):
    training = make_training(fake_store, tmp_path, batch_size=6, epochs=2)
    apart = replace(training, team=FollowerElsewhere(0, 1))
    with pytest.raises(DataError, match="a state of step 0 here, the first one of 4"):
        fit(apart)


@pytest.mark.parametrize(("name", "value"), [("RANK", ""), ("LOCAL_RANK", "first")])
def test_half_of_torchruns_variables_end_with_a_sentence(monkeypatch, name, value):
    for variable in ("WORLD_SIZE", "RANK", "LOCAL_RANK", "LOCAL_WORLD_SIZE"):
        monkeypatch.setenv(variable, "2" if "SIZE" in variable else "0")
    monkeypatch.setenv(name, value)
    team.cache_clear()
    with pytest.raises(ConfigError, match=f"{name} is '{value}', not a number"):
        team()
