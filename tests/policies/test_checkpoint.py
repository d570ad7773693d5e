"""Checkpoints come back as they were, or are refused by name."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from geoprior import load_policy
from geoprior.errors import ConfigError, DataError
from geoprior.files import sha256_file
from geoprior.options import Choice
from geoprior.policies.checkpoint import (
    CheckpointHeader,
    checkpoint_path,
    list_checkpoints,
    load_checkpoint,
    load_predictor,
    load_weights,
    save_checkpoint,
)
from geoprior.policies.normalise import measure
from geoprior.policies.policy import Features
from geoprior.policies.tensors import load_tensors, save_tensors

FEATURES = Features(cameras=("hand", "third"), image_size=(40, 64), hands=("hand",), chunk=5)
OPTIONS = {
    "chunk": 5,
    "dim": 16,
    "heads": 2,
    "ffn": 24,
    "encoder_layers": 2,
    "vae_layers": 1,
    "latent": 4,
    "trunk_width": 8,
}


def make_header(**changes):
    rows = np.random.default_rng(0).normal(size=(20, 8)).astype(np.float32)
    fields = {
        "policy": Choice(name="act", options=OPTIONS),
        "features": FEATURES,
        "fps": 10.0,
        "statistics": {"pose": measure([rows]), "action": measure([rows * 2])},
        "epoch": 3,
        "step": 12,
        "details": {"data": {"digest": "abc"}},
    }
    return CheckpointHeader(**{**fields, **changes})


@pytest.fixture
def saved(tmp_path, make_act):
    act = make_act(seed=5)
    path = checkpoint_path(tmp_path, 3)
    save_checkpoint(path, act.state_dict(), make_header())
    return path, act


def edit_json(path, **changes):
    file = path.with_suffix(".json")
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


def replace_weights(path, tensors):
    """Other tensors with a JSON that vouches for them."""
    save_tensors(path, tensors, {})
    edit_json(path, weights={"bytes": path.stat().st_size, "sha256": sha256_file(path)})


def test_round_trip_bit_for_bit(saved):
    path, act = saved
    assert path.name == "epoch-000003.safetensors"
    header, tensors = load_checkpoint(path)
    assert header == make_header()
    for name, tensor in act.state_dict().items():
        assert torch.equal(tensors[name], tensor)


def test_the_same_weights_give_the_same_bytes(saved, tmp_path):
    path, act = saved
    other = checkpoint_path(tmp_path / "again", 3)
    save_checkpoint(other, act.state_dict(), make_header())
    assert other.read_bytes() == path.read_bytes()
    assert other.with_suffix(".json").read_bytes() == path.with_suffix(".json").read_bytes()


def test_lists_whole_checkpoints_by_epoch(tmp_path, make_act):
    assert list_checkpoints(tmp_path / "none") == ()
    for epoch in (1_000_000, 20, 3):
        save_checkpoint(checkpoint_path(tmp_path, epoch), make_act().state_dict(), make_header(epoch=epoch))
    checkpoint_path(tmp_path, 3).with_suffix(".json").unlink()
    (tmp_path / "epoch-last.safetensors").touch()
    assert [checkpoint.epoch for checkpoint in list_checkpoints(tmp_path)] == [20, 1_000_000]


def test_all_weights_or_the_trunk(saved, make_act):
    path, act = saved
    whole, trunk, untouched = make_act(seed=1), make_act(seed=1), make_act(seed=1).state_dict()
    assert set(load_weights(whole, path)) == set(act.state_dict())
    load_weights(trunk, path, "trunk")
    for name, tensor in act.state_dict().items():
        assert torch.equal(whole.state_dict()[name], tensor)
        expected = tensor if name.startswith("trunk.") else untouched[name]
        assert torch.equal(trunk.state_dict()[name], expected)


def test_the_trunk_fits_a_policy_of_other_sizes_and_cameras(saved, make_act):
    path, _ = saved
    other = Features(cameras=("wrist",), image_size=(96, 96), hands=("left", "right"), chunk=2)
    assert len(load_weights(make_act(features=other, dim=8), path, "trunk")) == 6 * 20


@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
def test_truncated_weights(saved, share):
    path, _ = saved
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DataError, match=r"epoch-000003.safetensors: not the weights.*cut off or changed"):
        load_checkpoint(path)


def test_one_changed_bit(saved):
    path, _ = saved
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(DataError, match="cut off or changed"):
        load_checkpoint(path)


def test_truncated_json(saved):
    path, _ = saved
    file = path.with_suffix(".json")
    file.write_text(file.read_text()[:200])
    with pytest.raises(DataError, match=r"epoch-000003.json: not readable as JSON"):
        load_checkpoint(path)


def test_missing_halves(saved):
    path, _ = saved
    file = path.with_suffix(".json")
    content = file.read_bytes()
    file.unlink()
    with pytest.raises(DataError, match=r"epoch-000003.json does not lie beside it"):
        load_checkpoint(path)
    file.write_bytes(content)
    path.unlink()
    with pytest.raises(DataError, match="no such checkpoint"):
        load_checkpoint(path)
    file.unlink()
    with pytest.raises(DataError, match=r"epoch-000003.safetensors: no such checkpoint"):
        load_checkpoint(path)


@pytest.mark.parametrize("name", ["epoch-000003.json", "README.md", "folder"])
def test_what_is_no_checkpoint_is_never_to_be_deleted(name, saved):
    path = saved[0].with_name(name)
    path.touch()
    with pytest.raises(DataError, match=f"{name}: not a checkpoint of geoprior") as caught:
        load_checkpoint(path)
    assert "delete" not in caught.value.hint


def test_foreign_files(saved):
    path, _ = saved
    path.with_suffix(".json").write_text('{"type": "act"}')
    with pytest.raises(DataError, match="not a checkpoint of geoprior"):
        load_checkpoint(path)
    path.with_suffix(".json").write_text("[]")
    with pytest.raises(DataError, match="not a checkpoint of geoprior"):
        load_checkpoint(path)


def test_weights_that_are_not_safetensors(saved):
    path, _ = saved
    path.write_bytes(b"PK\x03\x04 a pickle in a zip")
    edit_json(path, weights={"bytes": path.stat().st_size, "sha256": sha256_file(path)})
    with pytest.raises(DataError, match="not readable as safetensors"):
        load_checkpoint(path)


def test_other_versions(saved):
    path, _ = saved
    edit_json(path, format_version=9, geoprior="9.9")
    with pytest.raises(DataError, match=r"checkpoint format 9, this geoprior reads 2") as caught:
        load_checkpoint(path)
    assert "9.9" in caught.value.hint
    edit_json(path, format_version=2, normalisation={"std_floor": 0.0})
    with pytest.raises(DataError, match="key 'normalisation'"):
        load_checkpoint(path)


def test_a_missing_key_is_named(saved):
    path, _ = saved
    edit_json(path, features={"cameras": ["hand"]})
    with pytest.raises(DataError, match=r"malformed: features\.image_size: Field required"):
        load_checkpoint(path)


def test_missing_extra_and_misshapen_tensors(saved, make_act):
    path, act = saved
    tensors = dict(act.state_dict())
    replace_weights(path, {k: v for k, v in tensors.items() if k != "action_head.bias"})
    with pytest.raises(DataError, match=r"lacks the tensor 'action_head\.bias'"):
        load_weights(make_act(), path)
    with pytest.raises(DataError, match=r"lacks the tensor 'action_head\.bias'"):
        load_predictor(path)
    replace_weights(path, {**tensors, "trunk.fc.weight": torch.zeros(2)})
    for which in ("all", "trunk"):
        with pytest.raises(DataError, match=r"has the extra tensor 'trunk\.fc\.weight'"):
            load_weights(make_act(), path, which)
    replace_weights(path, {**tensors, "action_head.bias": torch.zeros(7)})
    with pytest.raises(
        DataError, match=r"'action_head.bias' is torch.float32 \(7,\), the policy's is .* \(8,\)"
    ):
        load_weights(make_act(), path)


def test_a_refused_checkpoint_changes_nothing(saved, make_act):
    path, act = saved
    replace_weights(path, {**act.state_dict(), "vae_head.bias": torch.zeros(7)})
    fresh = make_act(seed=9)
    before = {name: tensor.clone() for name, tensor in fresh.state_dict().items()}
    with pytest.raises(DataError, match=r"vae_head\.bias"):
        load_weights(fresh, path)
    assert all(torch.equal(tensor, before[name]) for name, tensor in fresh.state_dict().items())


def test_a_renamed_camera(saved, make_act):
    path, _ = saved
    other = Features(cameras=("hand", "top"), image_size=(40, 64), hands=("hand",), chunk=5)
    with pytest.raises(DataError, match="trained on the cameras hand, third, this data has hand, top"):
        load_weights(make_act(features=other), path)


def test_hands_in_another_order(saved, make_act):
    path, _ = saved
    trained = replace(FEATURES, hands=("left", "right"))
    sixteen = measure([np.random.default_rng(0).normal(size=(20, 16)).astype(np.float32)])
    statistics = {"pose": sixteen, "action": sixteen}
    header = replace(load_checkpoint(path)[0], features=trained, statistics=statistics)
    policy = make_act(features=trained)
    save_checkpoint(path, policy.state_dict(), header)
    load_weights(make_act(features=trained), path)
    swapped = make_act(features=replace(FEATURES, hands=("right", "left")))
    with pytest.raises(DataError, match="trained on the hands left, right, this data has right, left"):
        load_weights(swapped, path)
    load_weights(swapped, path, "trunk")


def test_missing_statistics(saved):
    path, _ = saved
    tree = json.loads(path.with_suffix(".json").read_text())
    edit_json(path, statistics={"pose": tree["statistics"]["pose"]})
    with pytest.raises(DataError, match="feature 'action' has no statistics"):
        load_predictor(path)


def test_a_policy_that_is_not_installed(saved):
    path, _ = saved
    edit_json(path, policy={"name": "diffusion"})
    with pytest.raises(ConfigError, match="unknown policy 'diffusion'"):
        load_predictor(path)


def test_an_unwritable_folder(tmp_path, make_act):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DataError, match="cannot be written"):
        save_checkpoint(checkpoint_path(tmp_path / "file", 1), make_act().state_dict(), make_header())


def test_tied_weights_are_saved_under_both_names(tmp_path):
    weight = torch.arange(6.0).reshape(2, 3)
    save_tensors(tmp_path / "tied.safetensors", {"a": weight, "b": weight, "c": weight[1]}, {})
    loaded = load_tensors(tmp_path / "tied.safetensors")
    assert loaded.keys() == {"a", "b", "c"}
    assert torch.equal(loaded["a"], weight)
    assert torch.equal(loaded["b"], weight)
    assert torch.equal(loaded["c"], weight[1])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("chunk", -1),
        ("chunk", 10**12),
        ("chunk", "many"),
        ("image_size", [0, 96]),
        ("image_size", [96]),
        ("cameras", []),
        ("hands", "hand"),
        ("focus", 1),
    ],
)
def test_features_of_a_stranger_are_checked(key, value, saved):
    path = saved[0]
    features = json.loads(path.with_suffix(".json").read_text())["features"]
    edit_json(path, features={**features, key: value})
    with pytest.raises(DataError, match="key missing or malformed"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mean", [0.0]),
        ("mean", ["a"] * 8),
        ("mean", [None] * 8),
        ("mean", 0.0),
        ("std", [None] * 8),
        ("std", [-1.0] * 8),
        ("std", [1.0] * 7),
        ("count", -3),
    ],
)
def test_statistics_of_a_stranger_are_checked(key, value, saved):
    path = saved[0]
    statistics = json.loads(path.with_suffix(".json").read_text())["statistics"]
    edit_json(path, statistics={**statistics, "pose": {**statistics["pose"], key: value}})
    with pytest.raises(DataError, match="key missing or malformed"):
        load_checkpoint(path)
    edit_json(path, statistics=[])
    with pytest.raises(DataError, match="key missing or malformed"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("fps", 0.0),
        ("fps", -10.0),
        ("fps", "fast"),
        ("epoch", -1),
        ("step", 0.5),
        ("details", []),
        ("weights", {}),
        ("weights", []),
        ("weights", {"bytes": 3, "sha256": "short"}),
        ("policy", 3),
    ],
)
def test_all_else_of_a_stranger_is_checked(key, value, saved):
    path = saved[0]
    edit_json(path, **{key: value})
    with pytest.raises(DataError, match=f"key missing or malformed: {key}"):
        load_checkpoint(path)


def test_numbers_that_json_does_not_know_are_refused(saved):
    path = saved[0]
    edit_json(path, fps=float("nan"))
    with pytest.raises(DataError, match="not readable as JSON"):
        load_checkpoint(path)


def test_details_without_data_are_no_fault(saved):
    path = saved[0]
    edit_json(path, details={"note": "by hand"})
    assert load_checkpoint(path)[0].data is None


def test_the_trunk_of_a_policy_without_one_is_refused(saved, make_act, monkeypatch):
    policy = make_act()
    monkeypatch.setattr(type(policy), "trunk_prefixes", ())
    with pytest.raises(ConfigError, match="has no trunk, so nothing would be taken"):
        load_weights(policy, saved[0], "trunk")


def test_the_readme_shows_how_a_policy_is_used(saved, capsys):
    """Its lines run as they stand, on a checkpoint of this run instead of the quickstart's."""
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    (block,) = (
        part for part in re.findall(r"```python\n(.*?)```", readme, re.DOTALL) if "load_policy" in part
    )
    lines = re.sub(r'load_policy\(".*?"\)', f"load_policy({str(saved[0])!r})", block)
    exec(compile(lines, "README.md", "exec"), {})
    assert len(capsys.readouterr().out.split()) >= 8


def test_loading_a_policy_is_refused_in_words(tmp_path):
    with pytest.raises(DataError, match=r"none\.safetensors"):
        load_policy(tmp_path / "none.safetensors")
