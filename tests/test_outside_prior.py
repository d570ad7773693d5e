"""A run that takes another run's prior: its content is an input, its place is not."""

import shutil

from command_line import geoprior

from geoprior.config import load_config
from geoprior.hooks.manager import plugins
from geoprior.stages import STAGES

FINETUNE = next(stage for stage in STAGES if stage.name == "finetune")
PRETRAIN = next(stage for stage in STAGES if stage.name == "pretrain")


def load(*overrides):
    return load_config("lite", overrides, plugins())


def taking(path):
    return f"finetune.conditions.prior={{init: prior, statistics: pretrained, prior: {path}}}"


def fingerprint(config):
    return FINETUNE.config(config), FINETUNE.outside(config)


def test_a_prior_that_moves_changes_nothing_and_another_one_does(tiny_run, tmp_path):
    moved = shutil.copytree(tiny_run / "checkpoints" / "pretrain", tmp_path / "moved")
    here, there = fingerprint(load(taking(tiny_run))), fingerprint(load(taking(moved)))
    assert here == there
    first = min(moved.glob("epoch-*.safetensors"))
    config, digests = fingerprint(load(taking(first)))
    assert config == here[0]
    assert digests.keys() == {"prior of prior"}
    assert digests != here[1]


def test_whose_prior_it_is_stands_in_the_config_of_the_stage():
    assert FINETUNE.config(load()) != FINETUNE.config(load(taking("/anywhere")))


def test_without_one_the_config_of_a_stage_is_what_it_was():
    config = load()
    part = FINETUNE.config(config)
    expected = config.finetune.model_dump(mode="json", exclude=set(config.finetune.speed_only))
    for condition in expected["conditions"].values():
        assert condition.pop("prior") is None
    for name in config.finetune.later:
        assert expected.pop(name) == type(config.finetune).model_fields[name].default
    assert part["finetune"] == expected
    assert FINETUNE.outside(config) == {}


def test_a_blind_prior_enters_pretraining_only_where_it_is_wanted():
    plain, controls = (load_config(name, (), plugins()) for name in ("quickstart", "controls"))
    assert "blind_prior" not in PRETRAIN.config(plain)
    assert PRETRAIN.config(controls) == {**PRETRAIN.config(plain), "blind_prior": True}


def test_the_controls_are_the_quickstart_and_two_conditions():
    plain, controls = (load_config(name, (), plugins()) for name in ("quickstart", "controls"))
    added = {name: controls.finetune.conditions[name] for name in ("statistics-only", "blind")}
    assert controls.finetune.conditions == plain.finetune.conditions | added
    assert controls.model_copy(update={"finetune": plain.finetune}) == plain


def test_a_prior_that_is_missing_is_said_before_anything_is_made(tmp_path):
    done = geoprior("", "run", "lite", "--out", tmp_path / "run", "--set", taking(tmp_path / "no"))
    assert done.returncode == 4
    assert f"finetune.conditions.prior.prior: {tmp_path}/no: no such file or folder" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "run" / "shards").exists()
