import os
import subprocess
import sys
from importlib.util import find_spec

import pytest
from episode_material import make_episode, make_folder, same  # noqa: F401 - fixtures
from filelock import FileLock
from hypothesis import settings

# How long an example takes says something about the machine and nothing about the code.
settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")

pytest_plugins = ["geoprior.authoring.testing"]
# `make test-core` has an environment without the extra `sim`: what is left must work there.
NEEDS_SIMULATION = (
    "sim/*",
    "bench/test_bench_rollout.py",
    "bench/test_bench_demos.py",
    "probe/test_aim.py",
    "test_task_gallery.py",
)
collect_ignore_glob = [] if find_spec("mujoco") else list(NEEDS_SIMULATION)
os.environ.setdefault("MUJOCO_GL", "egl")
os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture
def run_python():
    """Run code in a fresh interpreter; its failure is the test's."""

    def run(code, **environment):
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


TINY = """
extends: lite
cameras: {height: 32, width: 32}
executor: {name: local, workers: 2}
generate: {episodes: 4, seconds: 2, episodes_per_shard: 2}
policy: {name: act, chunk: 4, dim: 16, heads: 2, ffn: 32, encoder_layers: 1, vae_layers: 1, trunk_width: 8}
pretrain:
  {epochs: 6, batch_size: 4, checkpoint_every: 2, precision: fp32, log_every: 1, resume_seconds: 0,
   probe_episodes: 2}
demos: {episodes: 3}
finetune: {epochs: 8, batch_size: 2, checkpoint_every: 4, precision: fp32}
evaluate: {trials: 3, time_limit: 0.6}
"""
"""The whole line in the smallest sizes: real at every point, good for nothing."""


@pytest.fixture(scope="session")
def tiny_config(tmp_path_factory):
    """A config file whose run takes seconds."""
    path = tmp_path_factory.mktemp("config") / "tiny.yaml"
    path.write_text(TINY)
    return path


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory):
    """A finished run of it, made once for all test processes; copy it before you harm it."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    run, config = shared / "tiny" / "run", shared / "tiny.yaml"
    with FileLock(shared / "tiny.lock"):
        if not run.exists():
            config.write_text(TINY)
            command = [sys.executable, "-m", "geoprior", "run", str(config), "--out", str(run)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
    return run
