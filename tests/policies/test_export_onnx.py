"""The ONNX file says what the checkpoint's predictor says, whatever the policy, and onnxruntime is enough."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from click.testing import CliRunner
from torch import nn

from geoprior import PolicySpec, hookimpl
from geoprior.cli import cli
from geoprior.errors import DataError, MachineError, NumericalError, PluginError
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies import export_onnx as export
from geoprior.policies.act._network import ActNetwork
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.checkpoint import CheckpointHeader, load_predictor, save_checkpoint
from geoprior.policies.deployed import commands
from geoprior.policies.export_onnx import METADATA_KEY, export_onnx, largest_difference
from geoprior.policies.normalise import measure
from geoprior.policies.policy import Features, PolicyOptions
from geoprior.policies.predictor import LoadedPredictor, to_commands

FEATURES = Features(cameras=("hand", "third"), image_size=(40, 64), hands=("hand",), chunk=5)
NESTED = Features(cameras=("add", "pose-2", "view"), image_size=(6, 7), hands=("left", "right"), chunk=2)
"""Two hands, and cameras that are named as tensors inside a graph are."""
SIZES = {"dim": 16, "heads": 2, "ffn": 24, "encoder_layers": 1, "vae_layers": 1, "latent": 4}


class Odd(nn.Module):
    """Everything that ACT is not: it keeps no state of its own, and it counts rows."""

    trunk_prefixes = ("eye.",)

    def __init__(self, config, features):
        super().__init__()
        self.config, self.features = config, features
        self.head = nn.Linear(features.pose_size, features.chunk * features.pose_size)
        self.eye = nn.Linear(3 * len(features.cameras), features.pose_size)

    def predict(self, observation):
        pose = observation["pose"]
        seen = observation["images"].amax((-1, -2)).reshape(len(pose), -1)
        actions = self.head((pose + self.eye(seen)).tanh())
        if self.config.branches and actions.sum() > 0:
            actions = -actions
        return actions.reshape(-1, self.features.chunk, self.features.pose_size)


class OddConfig(PolicyOptions):
    branches: bool = False


class OddPlugin:
    @hookimpl
    def geoprior_policies(self):
        yield PolicySpec("odd", "not ACT", OddConfig, Odd)


@pytest.fixture(scope="module", autouse=True)
def odd_policy():
    found = plugins()
    registry = dict(found._registry)
    found.register(OddPlugin(), name="odd", package="test", version="0")
    yield
    found._manager.unregister(name="odd")
    found._registry = registry
    found._found = [plugin for plugin in found._found if plugin.name != "odd"]


def write(path, policy, name, features, **options):
    rows = np.random.default_rng(0).normal(size=(20, features.pose_size)).astype(np.float32)
    rows[:, 7] = 1.0
    header = CheckpointHeader(
        policy=Choice(name=name, options={"chunk": features.chunk, **options}),
        features=features,
        fps=10.0,
        statistics={"pose": measure([rows]), "action": measure([rows * 0.3 + 0.5])},
        epoch=3,
        step=12,
        details={},
    )
    save_checkpoint(path, policy.state_dict(), header)
    return header


def write_act(path, **options):
    """A trunk whose running statistics are none that a fresh one has."""
    options = {**SIZES, "trunk_width": 8, **options}
    torch.manual_seed(3)
    act = ActNetwork(ActConfig(chunk=FEATURES.chunk, **options), FEATURES)
    for key, tensor in act.state_dict().items():
        if key.endswith(("running_mean", "running_var")):
            tensor.add_(torch.empty_like(tensor).uniform_(-0.5, 0.5))
    return write(path, act, "act", FEATURES, **options)


def write_odd(folder, features=NESTED, seed=1, **options):
    torch.manual_seed(seed)
    path = folder / f"odd-{seed}.safetensors"
    write(path, Odd(OddConfig(**options), features), "odd", features, **options)
    return path


@pytest.fixture(scope="module")
def exported(odd_policy, tmp_path_factory):
    """A checkpoint and its file: torch takes seconds for each, so it is made once."""
    folder = tmp_path_factory.mktemp("odd")
    checkpoint = write_odd(folder)
    return checkpoint, export_onnx(checkpoint, folder / "odd.onnx")


@pytest.fixture
def drawn_before(exported, monkeypatch):
    """An export takes seconds no more: its graph is that of `exported`, whatever the checkpoint."""
    monkeypatch.setattr(export, "_as_graph", lambda *_: onnx.load(exported[1].path))
    return exported[0]


def observe(features, rows, seed=0):
    rng = np.random.default_rng(seed)
    shape = (rows, *features.image_size, 3)
    frames = {name: rng.integers(256, size=shape, dtype=np.uint8) for name in features.cameras}
    return rng.normal(size=(rows, features.pose_size)).astype(np.float32), frames


def assert_says_the_same(checkpoint, file, features):
    predictor = load_predictor(checkpoint)
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    for rows in (1, 3):
        pose, frames = observe(features, rows, seed=rows)
        (actions,) = session.run(["action"], {"pose": pose, **frames})
        expected = predictor.predict(pose, frames)
        assert actions.dtype == np.float32
        np.testing.assert_allclose(actions, expected, atol=1e-5, rtol=0.0)
        assert np.ptp(actions[..., :3]) > 1e-2, "numbers all alike would agree by accident"


@pytest.mark.slow
@pytest.mark.parametrize("norm", ["batch", "frozen", "group"])
def test_act_says_the_same_under_onnxruntime(tmp_path, norm):
    checkpoint = tmp_path / "epoch-000003.safetensors"
    write_act(checkpoint, trunk_norm=norm)
    done = export_onnx(checkpoint, tmp_path / "act.onnx")
    assert 0.0 < done.deviation < 1e-5
    assert_says_the_same(checkpoint, done.path, FEATURES)


def test_any_policy_any_hands_any_cameras(exported):
    checkpoint, done = exported
    assert 0.0 < done.deviation < 1e-5
    assert_says_the_same(checkpoint, done.path, NESTED)


def test_onnxruntime_is_enough(exported, tmp_path, run_python):
    """The file is moved, and nothing of geoprior or torch is imported: rate and cameras stand in it."""
    checkpoint, done = exported
    moved = Path(shutil.copy(done.path, tmp_path / "moved.onnx"))
    pose, frames = observe(NESTED, 2)
    np.savez(tmp_path / "seen.npz", pose=pose, **frames)
    run_python(
        "import json, sys, numpy as np, onnxruntime\n"
        f"session = onnxruntime.InferenceSession({str(moved)!r}, providers=['CPUExecutionProvider'])\n"
        f"seen = np.load({str(tmp_path / 'seen.npz')!r})\n"
        f"about = json.loads(session.get_modelmeta().custom_metadata_map[{METADATA_KEY!r}])\n"
        "inputs = {name: seen[name] for name in ('pose', *about['cameras'])}\n"
        f"np.save({str(tmp_path / 'said.npy')!r}, session.run(None, inputs)[0])\n"
        "assert not {'torch', 'geoprior', 'onnx'} & set(sys.modules)\n"
    )
    said = load_predictor(checkpoint).predict(pose, frames)
    np.testing.assert_allclose(np.load(tmp_path / "said.npy"), said, atol=1e-5, rtol=0.0)


def test_the_file_describes_itself_and_tells_nothing_of_this_machine(exported):
    model = onnx.load(exported[1].path)
    assert str(Path(__file__).parent).encode() not in exported[1].path.read_bytes()
    about = json.loads({p.key: p.value for p in model.metadata_props}[METADATA_KEY])
    assert (about["format_version"], about["fps"], about["chunk"], about["hands"]) == (
        2,
        10.0,
        2,
        ["left", "right"],
    )
    assert about["cameras"] == ["add", "pose-2", "view"]
    assert about["pose_fields"] == ["x", "y", "z", "qx", "qy", "qz", "qw", "gripper"]
    assert about["frames"] == {"height": 6, "width": 7, "channels": 3, "order": "RGB", "type": "uint8"}

    def shapes(values):
        return {
            value.name: (
                onnx.TensorProto.DataType.Name(value.type.tensor_type.elem_type),
                [axis.dim_param or axis.dim_value for axis in value.type.tensor_type.shape.dim],
            )
            for value in values
        }

    assert shapes(model.graph.input) == {
        "pose": ("FLOAT", ["batch", 16]),
        **dict.fromkeys(NESTED.cameras, ("UINT8", ["batch", 6, 7, 3])),
    }
    assert shapes(model.graph.output) == {"action": ("FLOAT", ["batch", 2, 16])}


@pytest.mark.slow
def test_the_file_is_the_same_every_time(exported, tmp_path):
    checkpoint, done = exported
    assert export_onnx(checkpoint, tmp_path / "b.onnx").path.read_bytes() == done.path.read_bytes()


def test_an_observation_that_is_not_finite_spoils_its_own_row_alone(exported):
    session = onnxruntime.InferenceSession(exported[1].path)
    pose, frames = observe(NESTED, 3)
    pose[1, 2] = np.nan
    (actions,) = session.run(None, {"pose": pose, **frames})
    assert np.isnan(actions[1]).all()
    assert np.isfinite(actions[[0, 2]]).all()


def test_commands_are_made_in_torch_as_in_numpy():
    actions = np.random.default_rng(0).normal(size=(40, 3, 16)).astype(np.float32)
    actions[0, 0, :8] = 0.0
    actions[1, 0, 7], actions[1, 1, 7] = 0.5, np.nextafter(np.float32(0.5), np.float32(1.0))
    actions[2, 0, 5], actions[3, 0, 9] = np.nan, np.inf
    made = commands(torch.from_numpy(actions)).numpy()
    np.testing.assert_allclose(made, to_commands(actions), atol=1e-7, rtol=0.0, equal_nan=True)
    assert made[1, :2, 7].tolist() == [0.0, 1.0]


def test_a_graph_that_says_other_actions_is_not_written(drawn_before, tmp_path):
    other = write_odd(tmp_path, seed=2)
    with pytest.raises(NumericalError, match="under onnxruntime its actions differ by"):
        export_onnx(other, tmp_path / "out" / "odd.onnx")
    assert not (tmp_path / "out").exists()


def test_actions_that_are_not_finite_are_not_written(drawn_before, tmp_path, monkeypatch):
    monkeypatch.setattr(LoadedPredictor, "predict", lambda *_: np.full((1, 2, 16), np.nan, np.float32))
    with pytest.raises(NumericalError, match="differ by nan"):
        export_onnx(drawn_before, tmp_path / "odd.onnx")
    assert not (tmp_path / "odd.onnx").exists()


def test_a_policy_that_is_no_graph_is_named(tmp_path):
    checkpoint = write_odd(tmp_path, branches=True)
    with pytest.raises(PluginError, match="policy 'odd': torch cannot turn its `predict` into a graph"):
        export_onnx(checkpoint, tmp_path / "out" / "odd.onnx")
    assert not (tmp_path / "out").exists()


def test_differences_are_in_units_of_the_raw_action():
    """A short quaternion turns far for a small error, and a gripper at the threshold may go either way."""
    raw = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3, 0.9]], np.float32)
    moved = raw + np.array([[0.0, 3e-6, 0.0, 4e-6, 0.0, 0.0, 0.0, 0.0]], np.float32)
    assert largest_difference(to_commands(moved), to_commands(raw), raw) == pytest.approx(4e-6, rel=0.01)
    raw[0, 7] = 0.5
    moved = raw + np.array([[0.0] * 7 + [2e-6]], np.float32)
    assert largest_difference(to_commands(moved), to_commands(raw), raw) == 0.0
    raw[0, 7], moved[0, 7] = 0.4, 0.6
    assert largest_difference(to_commands(moved), to_commands(raw), raw) == 1.0


@pytest.mark.parametrize("package", ["onnx", "onnxscript"])
def test_a_missing_package_comes_with_its_remedy(tmp_path, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MachineError, match=rf"the package {package} is missing") as caught:
        export_onnx(tmp_path / "none.safetensors", tmp_path / "odd.onnx")
    assert caught.value.hint == "pip install 'geoprior[onnx]'"


@pytest.mark.parametrize("camera", ["pose", "action"])
def test_a_camera_that_takes_another_tensors_name_is_named(tmp_path, camera):
    features = Features(cameras=(camera, "third"), image_size=(6, 7), hands=("hand",), chunk=2)
    with pytest.raises(DataError, match=f"a camera is named '{camera}'"):
        export_onnx(write_odd(tmp_path, features), tmp_path / "odd.onnx")


def test_weights_that_no_file_can_hold_are_refused(exported, tmp_path, monkeypatch):
    monkeypatch.setattr(export, "_LARGEST", 1000)
    with pytest.raises(DataError, match="its weights take"):
        export_onnx(exported[0], tmp_path / "odd.onnx")


def test_the_command_says_whether_it_compared(drawn_before, tmp_path, monkeypatch):
    runner, out = CliRunner(), tmp_path / "odd.onnx"
    arguments = ["export", "onnx", str(drawn_before), "--out", str(out)]
    done = runner.invoke(cli, arguments)
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines() == [str(out)]
    assert out.is_file()
    assert "under onnxruntime its actions differ from geoprior's by" in done.stderr
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    done = runner.invoke(cli, arguments)
    assert done.exit_code == 0, done.output
    assert "not compared: onnxruntime is not installed" in done.stderr


def test_a_place_that_cannot_be_written_is_named(drawn_before, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match=r"odd\.onnx: cannot be written"):
        export_onnx(drawn_before, tmp_path / "file" / "odd.onnx")
