"""The loop with a policy that is not ACT: it learns, it resumes to the bit, and it stops when it must."""

import json
import os
import signal
import subprocess
import sys
import time
from itertools import chain, repeat
from pathlib import Path

import pytest
import torch
from torch.optim.optimizer import register_optimizer_step_pre_hook
from training_material import make_training

from geoprior import hookimpl
from geoprior.errors import DataError, NumericalError
from geoprior.files import read_json
from geoprior.hooks.manager import plugins
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.training.loop import RESULT_NAME, fit, make_optimizer
from geoprior.training.order import steps_until
from geoprior.training.resume import RESUME_NAME

HERE = Path(__file__).parent


class Interrupt:
    """Ctrl-C, once, when a training logs a step."""

    def __init__(self, step):
        self.step, self.done = step, False

    @hookimpl
    def geoprior_train_step(self, event):
        if event.step == self.step and not self.done:
            self.done = True
            raise KeyboardInterrupt


@pytest.fixture
def interrupt_at():
    registered = []

    def register(step):
        registered.append(Interrupt(step))
        plugins()._manager.register(registered[-1])
        return registered[-1]

    yield register
    for plugin in registered:
        plugins()._manager.unregister(plugin)


def written(folder):
    """The bytes of everything that a training leaves, but for the times in its result."""
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.name != RESULT_NAME}
    result = json.loads((folder / RESULT_NAME).read_text())
    assert result.pop("seconds") >= 0
    return {**files, RESULT_NAME: result}


def test_it_learns(fake_store, tmp_path):
    first = fit(make_training(fake_store, tmp_path / "a", epochs=6, learning_rate=0.05))
    last = fit(make_training(fake_store, tmp_path / "b", epochs=90, learning_rate=0.05))
    assert last["metrics"]["l1"] < 0.5 * first["metrics"]["l1"]


def test_steps_checkpoints_and_log(fake_store, tmp_path):
    result = fit(make_training(fake_store, tmp_path, epochs=8, checkpoint_every=3, batch_size=3, log_every=4))
    assert (result["epochs"], result["steps"], result["samples"]) == (8, 14, 42)
    headers = {c.epoch: load_checkpoint(c.path)[0] for c in list_checkpoints(tmp_path)}
    assert {epoch: header.step for epoch, header in headers.items()} == {3: 5, 6: 10, 8: 14}
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [4, 8, 12, 14]
    assert lines[1]["epoch"] == pytest.approx(8 * 3 / 5)
    assert {"loss", "l1", "learning_rate"} <= lines[0].keys()
    assert not (tmp_path / RESUME_NAME).exists()


def test_the_same_seed_gives_the_same_bytes_and_another_one_others(fake_store, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        torch.rand(3)
        fit(make_training(fake_store, tmp_path / name, seed=seed))
    assert written(tmp_path / "a") == written(tmp_path / "b")
    names = ("a", "c")
    assert len({(tmp_path / name / "epoch-000008.safetensors").read_bytes() for name in names}) == 2


def test_the_caller_keeps_threads_and_random_state(fake_store, tmp_path):
    threads, state = torch.get_num_threads(), torch.get_rng_state()
    fit(make_training(fake_store, tmp_path))
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), state)


@pytest.mark.parametrize("resume_seconds", [0.0, 3600.0])
@pytest.mark.parametrize("step", [1, 5, 7, 14])
@pytest.mark.parametrize("average", [0.0, 0.9])
def test_an_interrupted_training_ends_alike(
    fake_store, tmp_path, interrupt_at, step, resume_seconds, average
):
    options = {
        "checkpoint_every": 3,
        "resume_seconds": resume_seconds,
        "warmup_steps": 9,
        "gradient_clip": 0.5,
        "average": average,
    }
    fit(make_training(fake_store, tmp_path / "whole", **options))
    interrupt = interrupt_at(step)
    with pytest.raises(KeyboardInterrupt):
        fit(make_training(fake_store, tmp_path / "cut", **options))
    assert interrupt.done
    assert not (tmp_path / "cut" / RESULT_NAME).exists()
    fit(make_training(fake_store, tmp_path / "cut", **options))
    assert written(tmp_path / "cut") == written(tmp_path / "whole")


def test_a_finished_training_is_not_repeated(fake_store, tmp_path, interrupt_at):
    result = fit(make_training(fake_store, tmp_path))
    interrupt = interrupt_at(1)
    assert fit(make_training(fake_store, tmp_path)) == result
    assert not interrupt.done


@pytest.mark.parametrize("suffix", [".safetensors", ".json"])
def test_a_lost_checkpoint_is_made_again(fake_store, tmp_path, suffix):
    fit(make_training(fake_store, tmp_path, checkpoint_every=3))
    before = written(tmp_path)
    (tmp_path / f"epoch-000003{suffix}").unlink()
    fit(make_training(fake_store, tmp_path, checkpoint_every=3))
    assert written(tmp_path) == before


def test_a_checkpoint_lost_before_the_state_of_a_killed_training_is_made_again(
    fake_store, tmp_path, interrupt_at
):
    options = {"checkpoint_every": 2, "resume_seconds": 0.0}
    fit(make_training(fake_store, tmp_path / "whole", **options))
    interrupt_at(9)
    with pytest.raises(KeyboardInterrupt):
        fit(make_training(fake_store, tmp_path / "cut", **options))
    lost = next(iter(sorted((tmp_path / "cut").glob("epoch-*.safetensors"))))
    lost.unlink()
    fit(make_training(fake_store, tmp_path / "cut", **options))
    assert written(tmp_path / "cut") == written(tmp_path / "whole")


def test_a_result_without_its_checkpoint_and_with_a_state_is_trained_again(
    fake_store, tmp_path, interrupt_at
):
    fit(make_training(fake_store, tmp_path / "whole", checkpoint_every=3))
    interrupt_at(9)
    options = {"checkpoint_every": 3, "resume_seconds": 0.0}
    with pytest.raises(KeyboardInterrupt):
        fit(make_training(fake_store, tmp_path / "cut", **options))
    state = (tmp_path / "cut" / RESUME_NAME).read_bytes()
    fit(make_training(fake_store, tmp_path / "cut", **options))
    (tmp_path / "cut" / RESUME_NAME).write_bytes(state)
    (tmp_path / "cut" / "epoch-000003.safetensors").unlink()
    fit(make_training(fake_store, tmp_path / "cut", **options))
    assert written(tmp_path / "cut") == written(tmp_path / "whole")


def test_a_state_left_beside_the_result_is_removed(fake_store, tmp_path):
    fit(make_training(fake_store, tmp_path))
    (tmp_path / RESUME_NAME).write_text("left by a kill")
    fit(make_training(fake_store, tmp_path))
    assert not (tmp_path / RESUME_NAME).exists()


def test_a_metric_that_is_not_finite_is_null_and_stops_nothing(fake_store, tmp_path):
    training = make_training(fake_store, tmp_path, log_every=1)
    whole, rates = training.policy.loss, chain([torch.inf], repeat(2.0))

    def loss(batch):
        value, scalars = whole(batch)
        return value, {**scalars, "rate": torch.tensor(next(rates)), "never": torch.tensor(torch.nan)}

    training.policy.loss = loss
    result = fit(training)
    assert result["metrics"]["rate"] == pytest.approx(2.0)
    assert "never" not in result["metrics"]
    first, second, *_ = (tmp_path / "log.jsonl").read_text().splitlines()
    assert (json.loads(first)["rate"], json.loads(second)["rate"]) == (None, 2.0)
    assert read_json(tmp_path / RESULT_NAME) == result


def test_leftovers_of_a_killed_write_are_swept(fake_store, tmp_path):
    leftovers = [tmp_path / f".{RESUME_NAME}.123.tmp", tmp_path / ".tmpXy7"]
    for leftover in leftovers:
        leftover.write_text("half")
    fit(make_training(fake_store, tmp_path))
    assert not any(leftover.exists() for leftover in leftovers)


def test_another_trainings_files_are_refused(fake_store, tmp_path, interrupt_at):
    interrupt_at(5)
    with pytest.raises(KeyboardInterrupt):
        fit(make_training(fake_store, tmp_path, resume_seconds=0.0))
    with pytest.raises(DataError, match=r"resume.safetensors: of a training with another config"):
        fit(make_training(fake_store, tmp_path, learning_rate=0.5))
    fit(make_training(fake_store, tmp_path / "done"))
    with pytest.raises(DataError, match=r"result.json: of a training with another config"):
        fit(make_training(fake_store, tmp_path / "done", learning_rate=0.5))


@pytest.mark.parametrize("content", [b"", b"not safetensors at all", None])
def test_a_damaged_state_is_named(fake_store, tmp_path, interrupt_at, content):
    interrupt_at(5)
    with pytest.raises(KeyboardInterrupt):
        fit(make_training(fake_store, tmp_path, resume_seconds=0.0))
    path = tmp_path / RESUME_NAME
    path.write_bytes(path.read_bytes()[:-9] if content is None else content)
    with pytest.raises(DataError, match=r"resume.safetensors: not readable"):
        fit(make_training(fake_store, tmp_path, resume_seconds=0.0))


def test_a_checkpoint_is_no_state(fake_store, tmp_path):
    fit(make_training(fake_store, tmp_path))
    (tmp_path / RESULT_NAME).unlink()
    (tmp_path / "epoch-000008.safetensors").rename(tmp_path / RESUME_NAME)
    with pytest.raises(DataError, match="not a training's state"):
        fit(make_training(fake_store, tmp_path))


def test_a_nan_loss_stops_and_keeps_the_last_good_state(fake_store, tmp_path):
    training = make_training(fake_store, tmp_path / "bad", resume_seconds=0.0)
    whole, right = training.policy.loss, [True] * 6 + [False]

    def poisoned(batch):
        loss, scalars = whole(batch)
        return (loss, scalars) if right.pop(0) else (loss * torch.nan, scalars)

    training.policy.loss = poisoned
    with pytest.raises(NumericalError, match="test: the loss is nan at step 7") as caught:
        fit(training)
    assert f"the last good state is kept in {tmp_path / 'bad'}" in caught.value.hint
    fit(make_training(fake_store, tmp_path / "bad", resume_seconds=0.0))
    fit(make_training(fake_store, tmp_path / "good", resume_seconds=0.0))
    assert written(tmp_path / "bad") == written(tmp_path / "good")


def test_weights_that_are_not_finite_are_never_saved(fake_store, tmp_path):
    training = make_training(fake_store, tmp_path, resume_seconds=0.0)

    def poison(parameter):
        parameter.grad[...] = torch.inf

    training.policy.head.weight.register_post_accumulate_grad_hook(poison)
    with pytest.raises(
        NumericalError, match=r"the weight 'head.weight' is not finite after step 1"
    ) as caught:
        fit(training)
    assert "kept" not in caught.value.hint
    assert not (tmp_path / RESUME_NAME).exists()
    assert list_checkpoints(tmp_path) == ()


def test_learning_rates_warm_up_and_the_trunk_has_its_own(fake_store, tmp_path):
    training = make_training(
        fake_store, tmp_path, learning_rate=0.1, trunk_learning_rate=0.01, warmup_steps=4, log_every=1
    )
    trunk, rest = make_optimizer(training.config, training.policy, training.machine).param_groups
    assert (trunk["lr"], rest["lr"]) == (0.01, 0.1)
    assert {id(p) for p in trunk["params"]} == {id(p) for p in training.policy.eye.parameters()}
    assert len(rest["params"]) == 4
    fit(training)
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    rates = [line["learning_rate"] for line in lines]
    assert rates[:5] == pytest.approx([0.025, 0.05, 0.075, 0.1, 0.1])


def test_clipping_bounds_the_gradient(fake_store, tmp_path):
    training = make_training(fake_store, tmp_path, gradient_clip=1e-3, epochs=1)
    norms = []

    def observe(optimizer, *_):
        grads = [p.grad.norm() for group in optimizer.param_groups for p in group["params"]]
        norms.append(torch.stack(grads).norm().item())

    handle = register_optimizer_step_pre_hook(observe)
    try:
        fit(training)
    finally:
        handle.remove()
    assert norms
    assert all(norm == pytest.approx(1e-3, rel=1e-3) for norm in norms)


OPTIONS = {"epochs": 48, "checkpoint_every": 16}
SLOW = """
import pathlib, sys, time
sys.path.insert(0, sys.argv[1])
from training_material import FakeStore, make_demonstration, make_training
from geoprior.training.loop import fit
store = FakeStore([make_demonstration(index, steps=6 + index) for index in range(5)])
options = {"epochs": 48, "checkpoint_every": 16, "resume_seconds": 0.0}
folder, workers, precision = pathlib.Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
training = make_training(store, folder, loader_workers=workers, precision=precision, **options)
loss = training.policy.loss
training.policy.loss = lambda batch: (time.sleep(0.03), loss(batch))[1]
fit(training)
"""


@pytest.mark.parametrize(("workers", "precision"), [(0, "fp32"), (1, "bf16"), (2, "fp32")])
def test_killed_at_any_moment_it_ends_with_the_same_bytes(fake_store, tmp_path, workers, precision):
    """Two real SIGKILLs while it steps and saves; then this process takes it to the end.

    The log has the loss of every step, which tells the samples that the step saw.
    """
    folder = tmp_path / "killed"
    log = folder / "log.jsonl"
    for least in (8, 30):
        process = subprocess.Popen(
            [sys.executable, "-c", SLOW, str(HERE), str(folder), str(workers), precision]
        )
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and process.poll() is None and lines_in(log) < least:
            time.sleep(0.003)
        assert process.poll() is None, "it ended before it could be killed"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    assert 30 <= lines_in(log) < steps_until(48, 5, 3)
    fit(make_training(fake_store, folder, loader_workers=workers, precision=precision, **OPTIONS))
    fit(make_training(fake_store, tmp_path / "whole", precision=precision, **OPTIONS))
    assert written(folder) == written(tmp_path / "whole")
    assert lines_in(log) == steps_until(48, 5, 3)


def lines_in(path):
    return len(path.read_bytes().splitlines()) if path.exists() else 0
