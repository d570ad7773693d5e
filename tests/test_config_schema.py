import json

import pytest
import yaml
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from geoprior.cli import cli
from geoprior.config import load_config
from geoprior.config_schema import config_schema, option_lines
from geoprior.config_tree import packaged_configs
from geoprior.errors import ConfigError
from geoprior.hooks.manager import plugins
from geoprior.hooks.types import PolicySpec
from geoprior.options import Options


@pytest.fixture(scope="module")
def validator():
    schema = config_schema(plugins())
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


@pytest.mark.parametrize("name", sorted(packaged_configs()))
def test_the_packaged_configs_obey_the_schema_as_written_and_resolved(name, validator):
    validator.validate(yaml.safe_load(packaged_configs()[name].read_text()))
    validator.validate(load_config(name, (), plugins()).model_dump(mode="json"))


@pytest.mark.parametrize(
    "tree",
    [
        {"polcy": "act"},
        {"policy": "no such policy"},
        {"policy": {"name": "act", "kl_wait": 1.0}},
        {"policy": {"name": "act", "dim": "wide"}},
        {"policy": {"dim": 64}},
        {"robot": {"name": "ur5e", "gap": 0.16}},
        {"generate": {"motions": [{"name": "pick"}, {"name": "fly"}]}},
        {"same_environment": {"tasks": [{"name": "pile", "gap": 9}]}},
        {"evaluate": {"look": {"name": "repainted", "hue": -1}}},
    ],
    ids=json.dumps,
)
def test_the_schema_refuses_what_a_config_cannot_say(tree, validator):
    assert list(validator.iter_errors(tree))


def test_every_option_of_every_plug_in_is_explained_and_its_limits_told():
    for entry in plugins().registered():
        text = "\n".join(option_lines(entry.spec))
        assert entry.spec.summary in text
        for name, field in entry.spec.config.model_fields.items():
            assert f"  {name}" in text, (entry.spec.name, name)
            assert field.description, (entry.spec.name, name)
    lines = option_lines(plugins().spec("task", "pile"))
    assert "  gap: 0.15  [at least 0.14, at most 0.17]" in lines


def test_options_within_options_show_the_values_that_they_have_there():
    class Inner(Options):
        depth: int = 1

    class Outer(Options):
        inner: Inner = Inner(depth=7)
        sizes: tuple[int, int] = (1, 2)
        must: float

    spec = PolicySpec(name="nested", summary="two levels", config=Outer, factory=lambda *_: None)
    assert option_lines(spec)[1:] == [
        "  inner.depth: 7",
        "  sizes: [1, 2]  [2 items or more, 2 items or fewer]",
        "  must: (to be given)",
    ]


def test_the_command_line_prints_both():
    def printed(*arguments):
        return CliRunner().invoke(cli, arguments, catch_exceptions=False).output

    assert "kl_weight: 10.0" in printed("plugins", "show", "policy", "act")
    assert "ActConfig" in json.loads(printed("config", "schema"))["$defs"]
    assert "kl_weight" in json.loads(printed("plugins", "show", "policy", "act", "--json"))["properties"]
    with pytest.raises(ConfigError, match="unknown policy 'akt'"):
        printed("plugins", "show", "policy", "akt")
