import itertools
import json
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from geoprior.config import RunConfig, load_config, plugins_named, to_yaml
from geoprior.config_tree import (
    apply_override,
    differences,
    find_config,
    merge,
    packaged_configs,
    read_tree,
)
from geoprior.errors import ConfigError
from geoprior.hooks.manager import plugins

ROOT = Path(__file__).parents[1]
KEYS = st.sampled_from("abcd")
TREES = st.recursive(
    st.integers(0, 9), lambda inner: st.dictionaries(KEYS, inner, max_size=3) | st.lists(inner, max_size=2)
)
MAPPINGS = st.dictionaries(KEYS, TREES, max_size=3)


def load(text_or_name, *overrides, tmp_path=None):
    if tmp_path is None:
        return load_config(text_or_name, overrides, plugins())
    file = tmp_path / "mine.yaml"
    file.write_text(text_or_name)
    return load_config(file, overrides, plugins())


@pytest.mark.parametrize("name", sorted(packaged_configs()))
def test_every_packaged_config_loads_and_is_the_file_in_the_repository(name):
    load(name)
    assert packaged_configs()[name].resolve() == (ROOT / "configs" / f"{name}.yaml").resolve()


def test_the_papers_numbers():
    config = load("paper")
    assert (config.generate.fps, config.generate.seconds, config.generate.episodes) == (30, 10, 200)
    assert [motion.name for motion in config.generate.motions] == ["pick", "place", "push"]
    assert (config.cameras.height, config.cameras.width) == (480, 640)
    assert (config.pretrain.epochs, config.finetune.epochs) == (2000, 5000)
    assert (config.demos.episodes, config.evaluate.trials) == (20, 50)
    assert (config.finetune.checkpoint_every, list(config.finetune.seeds)) == (250, [0, 1, 2])
    assert config.policy.options["chunk"] == 25


@pytest.mark.parametrize("name", sorted(packaged_configs()))
def test_a_resolved_config_reads_back_as_itself(name, tmp_path):
    config = load(name)
    assert load(to_yaml(config), tmp_path=tmp_path) == config


def test_resolving_writes_out_every_option_of_every_plug_in():
    config = load("lite")
    for primitive in config.generate.primitives:
        model = plugins().spec("primitive", primitive.name).config
        assert set(primitive.options) == set(model.model_fields)
    assert set(config.policy.options) == set(plugins().spec("policy", "act").config.model_fields)


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("sed: 1", "key 'sed': there is no such key", "did you mean 'seed'"),
        ("generate: {episode: 3}", "key 'generate.episode': there is no such key", "'episodes'"),
        ("seed: many", "key 'seed'", "found 'many'"),
        ("seed: -1", "key 'seed'", "found -1"),
        ("generate: {fps: .nan}", "key 'generate.fps'", "found nan"),
        ("generate: 3", "key 'generate'", "found 3"),
        ("robot: ur5", "unknown robot 'ur5'", "did you mean 'ur5e'"),
        ("task: pik", "unknown task 'pik'", "did you mean 'pick'"),
        ("policy: akt", "unknown policy 'akt'", "act"),
        ("executor: lokal", "unknown executor 'lokal'", "did you mean 'local'"),
        ("generate: {motions: [pick, pusch]}", "unknown motion 'pusch'", "did you mean 'push'"),
        ("generate: {primitives: [cilinder]}", "unknown primitive 'cilinder'", "did you mean 'cylinder'"),
        ("generate: {renderer: pionts}", "unknown renderer 'pionts'", "did you mean 'points'"),
        ("policy: {name: act, dims: 3}", "option 'dims'", "dim"),
        ("policy: {name: act, chunk: long}", "option 'chunk'", ""),
        ("seed: 1\nseed: 2", "line 2: key 'seed' twice", ""),
        ("seed: [1", "not valid YAML (line", ""),
        ("- seed", "expected a mapping", ""),
        ("extends: [quickstart]", "key 'extends'", ""),
        ("extends: quikstart", "quikstart: no such config", "did you mean 'quickstart'"),
        ("evaluate: {first_state: 5}\ndemos: {first_state: 0}", "they must not overlap", ""),
        ("generate: {fps: 30}\npretrain: {skip: 1}", "a chunk must span the same time", ""),
    ],
)
def test_a_fault_is_a_sentence_with_file_key_and_remedy(tmp_path, text, message, hint):
    with pytest.raises(ConfigError) as caught:
        load(text, tmp_path=tmp_path)
    assert message in caught.value.message
    assert hint in caught.value.hint
    assert "mine.yaml" in caught.value.message or "quikstart" in caught.value.message
    assert caught.value.exit_code == 2


def test_extends_merges_mappings_and_replaces_lists(tmp_path):
    (tmp_path / "base.yaml").write_text("seed: 3\ngenerate: {episodes: 7, motions: [pick, push]}\n")
    config = load("extends: base.yaml\ngenerate: {motions: [place]}\n", tmp_path=tmp_path)
    assert (config.seed, config.generate.episodes) == (3, 7)
    assert [motion.name for motion in config.generate.motions] == ["place"]


def test_a_ring_of_extends_is_shown(tmp_path):
    (tmp_path / "a.yaml").write_text("extends: b.yaml")
    (tmp_path / "b.yaml").write_text("extends: a.yaml")
    with pytest.raises(ConfigError, match=r"a\.yaml -> .*b\.yaml -> .*a\.yaml"):
        read_tree(tmp_path / "a.yaml")


@given(MAPPINGS, MAPPINGS)
def test_merging_keeps_what_the_upper_one_says(base, over):
    merged = merge(base, over)
    assert set(merged) == set(base) | set(over)
    assert merge(base, {}) == base
    assert merge({}, over) == over
    assert merge(merged, over) == merged


def test_another_plug_in_does_not_inherit_the_options_of_the_first():
    base, over = {"policy": {"name": "act", "dim": 64}}, {"policy": {"name": "other"}}
    assert merge(base, over) == over
    assert merge(base, {"policy": {"dim": 32}}) == {"policy": {"name": "act", "dim": 32}}


def test_set_reaches_plain_keys_list_items_and_plug_in_options():
    config = load(
        "quickstart",
        "generate.episodes=3",
        "generate.motions=[push, pick]",
        "generate.motions.0.name=place",
        "policy.chunk=5",
        "robot=xarm7",
    )
    assert config.generate.episodes == 3
    assert [motion.name for motion in config.generate.motions] == ["place", "pick"]
    assert config.policy.options["chunk"] == 5
    assert config.robot.name == "xarm7"


def test_overrides_are_applied_in_turn_so_that_a_new_plug_ins_options_can_be_set():
    config = load("lite", "robot=kinova3", "robot.controller=exact", "task=pile", "task.gap=0.16")
    assert config.robot.options["controller"] == "exact"
    assert config.task.name == "pile"
    assert config.task.options["gap"] == 0.16
    assert load("lite", "task=pile").task.options | {"gap": 0.16} == config.task.options


def test_set_adds_a_condition_since_its_name_is_the_users():
    base = load("lite").finetune.conditions
    config = load("lite", "finetune.conditions.trunk={init: prior, weights: trunk}")
    assert config.finetune.conditions.keys() == {*base, "trunk"}
    assert config.finetune.conditions["trunk"].weights == "trunk"
    assert {name: config.finetune.conditions[name] for name in base} == base


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("task=pil", "--set task=pil: key 'task': unknown task 'pil'"),
        ("finetune.conditions.trunk=3", "key 'finetune.conditions.trunk'"),
        ("finetune.conditions.trunk.init=prior", "no key 'trunk'"),
        ("generate.episods=3", "no key 'episods'"),
        ("policy.dimension=3", "no key 'dimension'"),
        ("new=3", "no key 'new'"),
        ("seed.low=3", "no keys under a plain value"),
        ("generate.motions.9=pick", "not one of the"),
        ("generate.episodes", "expected KEY=VALUE"),
        ("=3", "expected KEY=VALUE"),
        ("seed=[1", "not YAML"),
        ("seed=soon", "--set: key 'seed'"),
        ("seed=-4", "--set: key 'seed'"),
    ],
)
def test_set_cannot_invent_keys_or_values(override, message):
    with pytest.raises(ConfigError) as caught:
        load("lite", override)
    assert message in caught.value.message


@given(MAPPINGS)
def test_an_override_changes_its_key_and_nothing_else(tree):
    for key in tree:
        changed = apply_override(tree, f"{key}=new")
        assert changed == {**tree, key: "new"}
        assert [line.split(":")[0].split(".")[0] for line in differences(tree, changed)] == [
            line.split(":")[0].split(".")[0] for line in differences({key: tree[key]}, {key: "new"})
        ]


def test_the_schema_describes_every_key():
    schema = RunConfig.model_json_schema()
    json.dumps(schema)
    undescribed = [
        f"{name}.{key}"
        for name, model in itertools.chain([("", schema)], schema["$defs"].items())
        for key, value in model.get("properties", {}).items()
        if "description" not in value
    ]
    assert undescribed == []


def test_the_schema_allows_both_forms_of_a_name():
    schema = RunConfig.model_json_schema()
    forms = {form["type"] for form in schema["$defs"]["Choice"]["anyOf"]}
    assert forms == {"string", "object"}


def test_built_in_names_need_no_package():
    assert plugins_named(load("lite").model_dump(mode="json"), plugins()) == {}


def test_a_path_wins_over_a_packaged_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("quickstart.yaml").write_text("seed: 5")
    assert find_config("quickstart.yaml") == Path("quickstart.yaml")


def test_a_config_is_data_not_code(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("seed: !!python/object/apply:os.system ['true']")
    with pytest.raises(ConfigError, match="not valid YAML"):
        load_config(file, (), plugins())
    assert yaml.safe_load("seed: 1") == {"seed": 1}
