"""The config of a run: one frozen model composed of the stages' own, and how it is read.

The order of precedence, lowest first: defaults, the file named by ``extends:``, the file, ``--set``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self, get_args

from pydantic import BaseModel, Field, ValidationError, model_validator

from geoprior.config_tree import apply_override, find_config, read_tree, suggest
from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import GROUP as PACKAGE
from geoprior.hooks.manager import Plugins
from geoprior.options import Choice, Options
from geoprior.sim.config import DemosConfig, EvaluateConfig, SameEnvironmentConfig
from geoprior.synthesis.config import GenerateConfig
from geoprior.training.config import FinetuneConfig, PretrainConfig
from geoprior.yaml_text import to_text

QUICKSTART = "quickstart"
KINDS = {
    ("demos", "look"): "look",
    ("evaluate", "look"): "look",
    ("executor",): "executor",
    ("generate", "motions"): "motion",
    ("generate", "primitives"): "primitive",
    ("generate", "renderer"): "renderer",
    ("generate", "variants"): "variant",
    ("policy",): "policy",
    ("pretrain", "source"): "source",
    ("robot",): "robot",
    ("same_environment", "robot"): "robot",
    ("same_environment", "tasks"): "task",
    ("task",): "task",
}
"""Where the config names a plug-in, and of which kind."""
_GENERATED = ("shards", "endless")
"""Sources of pretraining whose episodes the config's recipe makes."""
OPEN_KEYS = ("finetune.conditions",)
"""Mappings whose keys are names of the user's."""


class RunConfig(Options):
    """Everything that decides what a run computes."""

    seed: int = Field(0, ge=0, lt=2**63, description="Root of every random draw.")
    cameras: CamerasConfig = Field(
        default=CamerasConfig(), description="Size and lenses of the views that all data share."
    )
    executor: Choice = Field(
        default=Choice(name="local"),
        description="Engine for generation, demonstrations, rollouts and trainings side by side; never "
        "changes a result.",
    )
    generate: GenerateConfig = Field(default=GenerateConfig(), description="The geometric data set.")
    same_environment: SameEnvironmentConfig | None = Field(
        None,
        description="If given, the prior is learned from demonstrations in simulation in place of the "
        "geometric data set: the paper's same-environment condition.",
    )
    policy: Choice = Field(default=Choice(name="act"), description="What learns.")
    pretrain: PretrainConfig = Field(
        default=PretrainConfig(), description="How the prior is made from the geometric data set."
    )
    robot: Choice = Field(default=Choice(name="ur5e"), description="The arm.")
    task: Choice = Field(default=Choice(name="pick"), description="The downstream task.")
    demos: DemosConfig = Field(default=DemosConfig(), description="Scripted demonstrations.")
    finetune: FinetuneConfig = Field(
        default=FinetuneConfig(), description="Training on the demonstrations, per condition and seed."
    )
    evaluate: EvaluateConfig = Field(
        default=EvaluateConfig(), description="Rollouts on unseen initial states."
    )

    @property
    def has_recipe(self) -> bool:
        """Whether it says how the prior's episodes are made, so that fresh ones can be."""
        return self.same_environment is None and self.pretrain.source.name in _GENERATED

    @model_validator(mode="after")
    def _refuse_shared_states(self) -> Self:
        trials = self.evaluate.states
        seen = {"demos": self.demos, "same_environment": self.same_environment}
        for name, config in seen.items():
            if config is None:
                continue
            states = range(config.first_state, config.first_state + config.max_attempts)
            if max(states.start, trials.start) < min(states.stop, trials.stop):
                raise ValueError(
                    f"{name} may use the initial states {states.start}..{states.stop - 1} and evaluate uses "
                    f"{trials.start}..{trials.stop - 1}: they must not overlap; move evaluate.first_state"
                )
        return self

    @model_validator(mode="after")
    def _refuse_a_source_that_reads_nothing(self) -> Self:
        if self.same_environment is not None and self.pretrain.source.name != "shards":
            raise ValueError(
                f"same_environment writes shards and pretrain.source {self.pretrain.source.name!r} does not "
                "read them: set pretrain.source to shards"
            )
        return self

    @model_validator(mode="after")
    def _refuse_a_gain_that_nothing_measures(self) -> Self:
        if self.pretrain.until_vision_gain is not None and not self.has_recipe:
            raise ValueError(
                "pretrain.until_vision_gain: it is measured on fresh synthetic episodes, and this prior is "
                "not learned from any; set it to null"
            )
        return self

    @model_validator(mode="after")
    def _refuse_unequal_rates(self) -> Self:
        key, rate = "generate.fps", self.generate.fps
        if self.same_environment is not None:
            key, rate = "same_environment.control_rate", self.same_environment.control_rate
        prior = rate / self.pretrain.skip
        demos = self.demos.control_rate / self.finetune.skip
        if abs(prior - demos) > 1e-9:
            raise ValueError(
                f"the prior learns at {key} / pretrain.skip = {prior:g} Hz and the demonstrations "
                f"at demos.control_rate / finetune.skip = {demos:g} Hz: a chunk must span the same time"
            )
        return self


def load_config(source: str | Path, overrides: Sequence[str], plugins: Plugins) -> RunConfig:
    """Read, override, check and resolve a config.

    Args:
        source: A YAML file, or the name of a packaged config such as ``quickstart``.
        overrides: ``a.b=c`` each, applied in turn; the key must exist, the value is YAML.
        plugins: Where the names are looked up.

    Raises:
        ConfigError: Naming the file, the key and the remedy.
    """
    path = find_config(source)
    config = resolve(validate(read_tree(path), str(path)), plugins, str(path))
    if not overrides:
        return config
    tree = config.model_dump(mode="json")
    for override in overrides:
        tree = _spell_names_out(apply_override(tree, override, OPEN_KEYS))
        _write_options_out(tree, plugins, f"--set {override}")
    return resolve(validate(tree, "--set"), plugins, "--set")


def validate(tree: Mapping[str, Any], where: str) -> RunConfig:
    """Check a tree against the model.

    Raises:
        ConfigError: The first fault, with file, key, and the nearest known key when it is unknown.
    """
    try:
        return RunConfig.model_validate(tree)
    except ValidationError as error:
        faults = error.errors(include_url=False)
        first = faults[0]
        key = ".".join(str(part) for part in first["loc"])
        message = f"{where}: " + (f"key {key!r}: " if key else "") + _plain(first["msg"])
        hint = ""
        if first["type"] == "extra_forbidden":
            hint = suggest(str(first["loc"][-1]), _fields_at(first["loc"][:-1]), "keys")
        elif key:
            hint = f"found {first['input']!r}; `geoprior config schema` describes every key"
        if len(faults) > 1:
            hint += f" ({len(faults) - 1} more faults after this one)"
        raise ConfigError(message, hint) from error


def resolve(config: RunConfig, plugins: Plugins, where: str) -> RunConfig:
    """The same config with every option of every named plug-in written out.

    Raises:
        ConfigError: A name or an option is unknown.
    """
    tree = config.model_dump(mode="json")
    for keys, kind, choice in _named(tree):
        with _told_at(where, keys):
            choice.update(plugins.resolve(kind, Choice.model_validate(choice)).model_dump(mode="json"))
    return RunConfig.model_validate(tree)


def plugins_named(tree: Mapping[str, Any], plugins: Plugins) -> dict[str, str]:
    """Package and version of every third-party plug-in that a resolved tree, or a part of it, names."""
    found: dict[str, str] = {}
    for _, kind, choice in _named(tree):
        plugin = plugins.plugin_of(kind, choice["name"])
        if plugin.package != PACKAGE:
            found[f"{kind} {choice['name']}"] = f"{plugin.package} {plugin.version}"
    return found


def to_yaml(config: BaseModel) -> str:
    """The config as YAML that `load_config` reads back to the same config."""
    return to_text(config.model_dump(mode="json"))


def _named(tree: Mapping[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Every ``(key, kind, mapping)`` of a dumped tree that names a plug-in."""
    for keys, kind in KINDS.items():
        value: Any = tree
        for key in keys:
            value = value.get(key) if isinstance(value, Mapping) else None
        for choice in value if isinstance(value, list) else [value]:
            if choice and isinstance(choice, dict):
                yield ".".join(keys), kind, choice


def _spell_names_out(tree: dict[str, Any]) -> dict[str, Any]:
    """Write ``name`` as ``{name: name}`` where a plug-in is named, so that a key below it can be set."""
    for *parents, last in KINDS:
        parent: Any = tree
        for key in parents:
            parent = parent.get(key) if isinstance(parent, Mapping) else None
        if not isinstance(parent, dict):
            continue
        value = parent.get(last)
        if isinstance(value, str):
            parent[last] = {"name": value}
        elif isinstance(value, list):
            parent[last] = [{"name": item} if isinstance(item, str) else item for item in value]
    return tree


def _write_options_out(tree: Mapping[str, Any], plugins: Plugins, where: str) -> None:
    """Give every plug-in named so far its options, for the next override to find; faulty ones stay.

    Raises:
        ConfigError: A name is unknown.
    """
    for keys, kind, choice in _named(tree):
        with _told_at(where, keys):
            plugins.spec(kind, str(choice.get("name")))
        with suppress(ConfigError, ValidationError):
            choice.update(plugins.resolve(kind, Choice.model_validate(choice)).model_dump(mode="json"))


@contextmanager
def _told_at(where: str, keys: str) -> Iterator[None]:
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{where}: key {keys!r}: {error.message}", error.hint) from error


def _plain(message: str) -> str:
    return message.removeprefix("Value error, ").replace(
        "Extra inputs are not permitted", "there is no such key"
    )


def _fields_at(location: Sequence[int | str]) -> list[str]:
    model: Any = RunConfig
    for part in location:
        fields = getattr(model, "model_fields", {})
        if part in fields:
            model = fields[part].annotation
        elif get_args(model):
            model = get_args(model)[-1]
    return list(getattr(model, "model_fields", {}))
