"""An export says in LeRobot's terms what the checkpoint says.

LeRobot itself is asked by benchmarks/check_lerobot_export.py.
"""

import json

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from safetensors.torch import load_file, save_file

from geoprior.cli import cli
from geoprior.errors import ConfigError, DataError
from geoprior.options import Choice
from geoprior.policies.act._network import ActNetwork
from geoprior.policies.act.lerobot_names import POSITION_TABLE, from_lerobot
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.checkpoint import CheckpointHeader, checkpoint_path, load_predictor, save_checkpoint
from geoprior.policies.export_lerobot import CHECK_FILE, export_lerobot
from geoprior.policies.normalise import measure
from geoprior.policies.policy import Features
from geoprior.policies.predictor import to_commands

FEATURES = Features(cameras=("hand", "third"), image_size=(40, 64), hands=("hand",), chunk=5)
SIZES = {"chunk": 5, "dim": 16, "heads": 2, "ffn": 24, "encoder_layers": 2, "vae_layers": 1, "latent": 4}
BEFORE, AFTER = (
    f"policy_{name}.safetensors"
    for name in ("preprocessor_step_3_normalizer_processor", "postprocessor_step_0_unnormalizer_processor")
)


@pytest.fixture
def make_checkpoint(tmp_path):
    """A checkpoint whose trunk has seen something, and whose last channel of poses never moved."""

    def make(name="act", **options):
        options = {**SIZES, "trunk_width": 8, **options}
        torch.manual_seed(3)
        act = ActNetwork(ActConfig(**options), FEATURES)
        for key, tensor in act.state_dict().items():
            if key.endswith(("running_mean", "running_var")):
                tensor.add_(torch.empty_like(tensor).uniform_(-0.5, 0.5))
        rows = np.random.default_rng(0).normal(size=(20, 8)).astype(np.float32)
        rows[:, 7] = 1.0
        header = CheckpointHeader(
            policy=Choice(name=name, options=options),
            features=FEATURES,
            fps=10.0,
            statistics={"pose": measure([rows]), "action": measure([rows * 2 + 1])},
            epoch=3,
            step=12,
            details={},
        )
        path = checkpoint_path(tmp_path, 3)
        save_checkpoint(path, act.state_dict(), header)
        return path

    return make


def as_lerobot_says(folder):
    """The folder's network between LeRobot's formulas of normalisation, on the observations it carries."""
    config = json.loads((folder / "config.json").read_text())
    before, after, check = (load_file(folder / name) for name in (BEFORE, AFTER, CHECK_FILE))
    options = {**SIZES, "trunk_norm": "frozen", "trunk_width": 64}
    act = ActNetwork(ActConfig(**options), FEATURES)
    tensors = load_file(folder / "model.safetensors")
    tensors.pop(POSITION_TABLE)
    act.load_state_dict({from_lerobot(name): tensor for name, tensor in tensors.items()})
    seen = {}
    for name, feature in config["input_features"].items():
        raw = check[name].movedim(-1, 1) / 255.0 if feature["type"] == "VISUAL" else check[name]
        seen[name] = (raw - before[f"{name}.mean"]) / (before[f"{name}.std"] + 1e-8)
    images = [seen[name] for name in config["input_features"] if name in seen and "images" in name]
    chunks = act.eval().predict({"pose": seen["observation.state"], "images": torch.stack(images, dim=1)})
    return chunks * after["action.std"] + after["action.mean"]


@pytest.mark.parametrize("options", [{}, {"trunk_norm": "frozen"}, {"trunk_width": 64}], ids=str)
def test_the_folder_says_the_actions_of_the_checkpoint(make_checkpoint, tmp_path, options):
    """Whatever the trunk's width and norm: LeRobot's is of width 64 and frozen."""
    path = make_checkpoint(**options)
    export_lerobot(path, tmp_path / "out")
    check = load_file(tmp_path / "out" / CHECK_FILE)
    torch.testing.assert_close(as_lerobot_says(tmp_path / "out"), check["action"], atol=1e-5, rtol=0.0)
    frames = {name: check[f"observation.images.{name}"].numpy() for name in FEATURES.cameras}
    commands = load_predictor(path).predict(check["observation.state"].numpy(), frames)
    np.testing.assert_array_equal(to_commands(check["action"].numpy()), commands)


def test_the_check_would_see_frames_that_are_normalised_otherwise(make_checkpoint, tmp_path):
    export_lerobot(make_checkpoint(), tmp_path / "out")
    file = tmp_path / "out" / BEFORE
    statistics = load_file(file)
    statistics["observation.images.third.std"] *= 1.05
    save_file(statistics, file)
    check = load_file(tmp_path / "out" / CHECK_FILE)
    assert (as_lerobot_says(tmp_path / "out") - check["action"]).abs().max() > 1e-4


def test_the_files_are_lerobots_and_the_same_every_time(make_checkpoint, tmp_path):
    path = make_checkpoint()
    files = export_lerobot(path, tmp_path / "a")
    assert {file.name for file in files} == {
        "README.md",
        "config.json",
        CHECK_FILE,
        "model.safetensors",
        "policy_preprocessor.json",
        BEFORE,
        "policy_postprocessor.json",
        AFTER,
    }
    for first, second in zip(files, export_lerobot(path, tmp_path / "b"), strict=True):
        assert first.read_bytes() == second.read_bytes()
    for name in ("policy_preprocessor", "policy_postprocessor"):
        steps = json.loads((tmp_path / "a" / f"{name}.json").read_text())["steps"]
        states = {step["state_file"] for step in steps if "state_file" in step}
        assert all((tmp_path / "a" / state).is_file() for state in states)
        assert len(states) == 1


def test_a_channel_that_never_moved_keeps_the_floor(make_checkpoint, tmp_path):
    export_lerobot(make_checkpoint(), tmp_path / "out")
    assert load_file(tmp_path / "out" / BEFORE)["observation.state.std"][7] == pytest.approx(1e-2)


@pytest.mark.parametrize(
    ("given", "steps", "coefficient"),
    [({}, 5, None), ({"execute": 2}, 2, None), ({"ensembling": 0.01}, 1, 0.01)],
)
def test_how_it_is_run(make_checkpoint, tmp_path, given, steps, coefficient):
    export_lerobot(make_checkpoint(), tmp_path / "out", **given)
    config = json.loads((tmp_path / "out" / "config.json").read_text())
    assert (config["n_action_steps"], config["temporal_ensemble_coeff"]) == (steps, coefficient)


@pytest.mark.parametrize(
    ("options", "given", "error", "message"),
    [
        ({"trunk_norm": "group"}, {}, DataError, "group norm"),
        ({"trunk_width": 72}, {}, DataError, "wider than LeRobot's"),
        ({"name": "diffusion"}, {}, DataError, "a policy 'diffusion'"),
        ({}, {"execute": 6}, ConfigError, "execute 6: a chunk of this policy has 5"),
        ({}, {"execute": 0}, ConfigError, "execute 0"),
        ({}, {"execute": 1, "ensembling": 0.01}, ConfigError, "exclude each other"),
    ],
)
def test_what_cannot_be_exported_leaves_nothing(make_checkpoint, tmp_path, options, given, error, message):
    path = make_checkpoint(**options)
    with pytest.raises(error, match=message):
        export_lerobot(path, tmp_path / "out", **given)
    assert not (tmp_path / "out").exists()


def test_a_folder_in_use_is_left_alone(make_checkpoint, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").touch()
    with pytest.raises(DataError, match="not an empty folder"):
        export_lerobot(make_checkpoint(), tmp_path / "out")
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["mine"]


def test_the_command_writes_the_folder_and_names_what_is_missing(make_checkpoint, tmp_path):
    runner = CliRunner()
    arguments = ["export", "lerobot-policy", str(make_checkpoint()), "--out", str(tmp_path / "out")]
    done = runner.invoke(cli, [*arguments, "--execute", "3"])
    assert done.exit_code == 0, done.output
    assert str(tmp_path / "out" / "config.json") in done.output.splitlines()
    assert json.loads((tmp_path / "out" / "config.json").read_text())["n_action_steps"] == 3
    again = runner.invoke(cli, arguments)
    assert isinstance(again.exception, DataError)
    assert "not an empty folder" in str(again.exception)
