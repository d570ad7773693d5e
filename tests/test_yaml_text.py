"""What a user writes in YAML means what it looks like."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from geoprior.config import load_config
from geoprior.errors import ConfigError
from geoprior.hooks.manager import plugins
from geoprior.yaml_text import parse_yaml, to_text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-7", -7),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("1e2", 100.0),
        ("1.5e-4", 1.5e-4),
        ("1e-4", 1e-4),
        (".5", 0.5),
        ("-.inf", float("-inf")),
        ("true", True),
        ("False", False),
        ("yes", "yes"),
        ("off", "off"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("2026-12-01", "2026-12-01"),
        ("", None),
        ("~", None),
        ("null", None),
        ("[1, a, 2.0]", [1, "a", 2.0]),
        ("a: &b {x: 1}\nc: {<<: *b, y: 2}", {"a": {"x": 1}, "c": {"x": 1, "y": 2}}),
        ("a: &b {x: 1}\nc: {<<: *b, x: 2}", {"a": {"x": 1}, "c": {"x": 2}}),
    ],
)
def test_scalars_are_what_they_look_like(text, value):
    found = parse_yaml(text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\na: 2",
        "a: {b: 1, b: 2}",
        "[" * 5000 + "]" * 5000,
        "9" * 5000,
        "!!python/object/apply:os.system [ls]",
        "a: [",
    ],
)
def test_what_cannot_be_meant_is_refused(text):
    with pytest.raises(yaml.YAMLError):
        parse_yaml(text)


trees = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**30), 10**30) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(tree=trees)
def test_what_is_written_is_read_back(tree):
    assert parse_yaml(to_text(tree)) == tree


@given(
    text=st.sampled_from(["yes", "no", "on", "off", "1e2", "010", "1:30", "~", "null", "true", "<<", "=", ""])
)
def test_text_that_looks_like_something_else_stays_text_for_every_reader(text):
    written = to_text({"name": text})
    assert parse_yaml(written) == yaml.safe_load(written) == {"name": text}


@pytest.mark.parametrize(
    "override", ["seed=yes", "seed=true", "evaluate.trials=True", "finetune.seeds=[true]"]
)
def test_a_truth_value_is_no_number(override):
    key = override.split("=")[0]
    with pytest.raises(ConfigError, match=key):
        load_config("quickstart", (override,), plugins())


def test_a_whole_number_may_be_written_with_an_exponent():
    assert load_config("quickstart", ("evaluate.trials=1e2",), plugins()).evaluate.trials == 100
