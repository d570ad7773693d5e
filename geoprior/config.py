"""The config of a run: one frozen model composed of the stages' own, and how it is read.

The order of precedence, lowest first: defaults, the file named by ``extends:``, the file, ``--set``.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Self, get_args

import yaml
from pydantic import BaseModel, Field, ValidationError, model_validator

from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import Plugins
from geoprior.options import Choice, Options
from geoprior.shards.config import GenerateConfig
from geoprior.sim.config import DemosConfig, EvaluateConfig
from geoprior.training.config import FinetuneConfig, PretrainConfig

QUICKSTART = "quickstart"
KINDS = {
    ("executor",): "executor",
    ("generate", "motions"): "motion",
    ("generate", "primitives"): "primitive",
    ("generate", "renderer"): "renderer",
    ("policy",): "policy",
    ("robot",): "robot",
    ("task",): "task",
}
"""Where the config names a plug-in, and of which kind."""


class RunConfig(Options):
    """Everything that decides what a run computes."""

    seed: int = Field(0, ge=0, lt=2**63, description="Root of every random draw.")
    cameras: CamerasConfig = Field(
        default=CamerasConfig(), description="Size and lenses of the views that all data share."
    )
    executor: Choice = Field(
        default=Choice(name="local"),
        description="Engine for generation, demonstrations and rollouts; never changes a result.",
    )
    generate: GenerateConfig = Field(default=GenerateConfig(), description="The geometric data set.")
    policy: Choice = Field(default=Choice(name="act"), description="What learns.")
    pretrain: PretrainConfig = Field(
        default=PretrainConfig(), description="Training on the geometric data set."
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

    @model_validator(mode="after")
    def _refuse_shared_states(self) -> Self:
        demos = range(self.demos.first_state, self.demos.first_state + self.demos.max_attempts)
        trials = range(self.evaluate.first_state, self.evaluate.first_state + self.evaluate.trials)
        if max(demos.start, trials.start) < min(demos.stop, trials.stop):
            raise ValueError(
                f"demos may use the initial states {demos.start}..{demos.stop - 1} and evaluate uses "
                f"{trials.start}..{trials.stop - 1}: they must not overlap; move evaluate.first_state"
            )
        return self

    @model_validator(mode="after")
    def _refuse_unequal_rates(self) -> Self:
        prior = self.generate.fps / self.pretrain.skip
        demos = self.demos.control_rate / self.finetune.skip
        if abs(prior - demos) > 1e-9:
            raise ValueError(
                f"the prior learns at generate.fps / pretrain.skip = {prior:g} Hz and the demonstrations "
                f"at demos.control_rate / finetune.skip = {demos:g} Hz: a chunk must span the same time"
            )
        return self


def load_config(source: str | Path, overrides: Sequence[str], plugins: Plugins) -> RunConfig:
    """Read, override, check and resolve a config.

    Args:
        source: A YAML file, or the name of a packaged config such as ``quickstart``.
        overrides: ``a.b=c`` each; the key must exist, the value is YAML.
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
        tree = apply_override(tree, override)
    return resolve(validate(tree, "--set"), plugins, "--set")


def find_config(source: str | Path) -> Path:
    """The path of a config file or of a packaged config named by its stem.

    Raises:
        ConfigError: There is neither; the hint shows the packaged ones and the nearest.
    """
    path = Path(source)
    if path.is_file():
        return path
    packaged = packaged_configs()
    name = str(source).removesuffix(".yaml").removeprefix("configs/")
    if name in packaged:
        return packaged[name]
    raise ConfigError(f"{source}: no such config file", _suggest(name, packaged, "packaged configs"))


def packaged_configs() -> dict[str, Path]:
    """The configs that ship with geoprior, by name."""
    root = Path(str(resources.files("geoprior"))) / "configs"
    files = sorted([*root.glob("*.yaml"), *root.glob("*/*.yaml")])
    return {str(file.relative_to(root).with_suffix("")): file for file in files}


def read_tree(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Read a YAML file and the files that it extends into one tree; mappings merge, lists replace.

    Raises:
        ConfigError: Not readable, not YAML, a key twice, or files that extend each other in a ring.
    """
    real = path.resolve()
    if real in seen:
        ring = " -> ".join(str(file) for file in (*seen, real))
        raise ConfigError(f"{path}: files extend each other in a ring: {ring}", "break the ring")
    tree = _read_yaml(path)
    base = tree.pop("extends", None)
    if base is None:
        return tree
    if not isinstance(base, str):
        raise ConfigError(f"{path}: key 'extends': expected the name of one config file")
    beside = path.parent / base
    return merge(read_tree(beside if beside.is_file() else find_config(base), (*seen, real)), tree)


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``over`` laid on top: mappings merge, everything else replaces.

    A mapping that names another plug-in replaces the whole mapping: options of one plug-in mean nothing
    to the next.
    """
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        both_map = isinstance(below, Mapping) and isinstance(value, Mapping)
        renamed = both_map and "name" in value and value["name"] != below.get("name")
        merged[key] = merge(below, value) if both_map and not renamed else value
    return merged


def apply_override(tree: Mapping[str, Any], override: str) -> dict[str, Any]:
    """The tree with one ``a.b=c`` applied; list items go by number, as in ``generate.motions.0.name``.

    Raises:
        ConfigError: No ``=``, not YAML, or a key that does not exist.
    """
    key, separator, text = override.partition("=")
    if not separator or not key:
        raise ConfigError(f"--set {override}: expected KEY=VALUE", "for example --set generate.episodes=50")
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"--set {override}: the value is not YAML ({_problem(error)})") from error
    return dict(_replaced(tree, key.split("."), value, override))


def _replaced(node: Any, keys: Sequence[str], value: Any, override: str) -> Any:
    if not keys:
        return value
    key, rest = keys[0], keys[1:]
    if isinstance(node, Mapping):
        if key not in node:
            raise ConfigError(f"--set {override}: there is no key {key!r}", _suggest(key, node, "keys"))
        return {**node, key: _replaced(node[key], rest, value, override)}
    if isinstance(node, list):
        if not key.isdecimal() or int(key) >= len(node):
            raise ConfigError(f"--set {override}: {key!r} is not one of the {len(node)} items, from 0")
        place = int(key)
        return [*node[:place], _replaced(node[place], rest, value, override), *node[place + 1 :]]
    raise ConfigError(f"--set {override}: there are no keys under a plain value", f"leave out {key!r}")


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
            hint = _suggest(str(first["loc"][-1]), _fields_at(first["loc"][:-1]), "keys")
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
    for keys, kind in KINDS.items():
        parent = tree
        for key in keys[:-1]:
            parent = parent[key]
        value = parent[keys[-1]]
        try:
            if isinstance(value, list):
                parent[keys[-1]] = [_resolved(plugins, kind, item) for item in value]
            else:
                parent[keys[-1]] = _resolved(plugins, kind, value)
        except ConfigError as error:
            raise ConfigError(f"{where}: key {'.'.join(keys)!r}: {error.message}", error.hint) from error
    return RunConfig.model_validate(tree)


def to_yaml(config: BaseModel) -> str:
    """The config as YAML that `load_config` reads back to the same config."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, width=100)


def differences(old: Any, new: Any, prefix: str = "") -> list[str]:
    """Keys whose values differ between two trees, each as ``key: old -> new``."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        found: list[str] = []
        for key in [*old, *(key for key in new if key not in old)]:
            found += differences(old.get(key), new.get(key), f"{prefix}.{key}" if prefix else str(key))
        return found
    return [] if old == new else [f"{prefix}: {old!r} -> {new!r}"]


def _resolved(plugins: Plugins, kind: str, value: Any) -> dict[str, Any]:
    resolved = plugins.resolve(kind, Choice.model_validate(value))
    return resolved.model_dump(mode="json")


class _StrictLoader(yaml.SafeLoader):
    """A safe loader that refuses a key written twice instead of keeping the last."""


def _strict_mapping(loader: _StrictLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    keys = [loader.construct_object(key, deep=True) for key, _ in node.value]  # type: ignore[no-untyped-call]
    for (key_node, _), key in zip(node.value, keys, strict=True):
        if keys.count(key) > 1:
            raise yaml.MarkedYAMLError(problem=f"key {key!r} twice", problem_mark=key_node.start_mark)
    return loader.construct_mapping(node, deep=True)


_StrictLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _strict_mapping)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        tree = yaml.load(path.read_text(encoding="utf-8"), Loader=_StrictLoader)  # noqa: S506 - safe loader
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not a text file in UTF-8") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: not valid YAML ({_problem(error)})") from error
    if tree is None:
        return {}
    if not isinstance(tree, dict) or not all(isinstance(key, str) for key in tree):
        raise ConfigError(f"{path}: expected a mapping of keys, found {type(tree).__name__}")
    return tree


def _problem(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    text = getattr(error, "problem", None) or str(error)
    return f"line {mark.line + 1}: {text}" if mark else str(text)


def _plain(message: str) -> str:
    return message.removeprefix("Value error, ").replace(
        "Extra inputs are not permitted", "there is no such key"
    )


def _suggest(name: str, choices: Iterable[str], what: str) -> str:
    names = sorted(choices)
    near = difflib.get_close_matches(name, names, n=1)
    return (f"did you mean {near[0]!r}? " if near else "") + f"{what}: {', '.join(names)}"


def _fields_at(location: Sequence[int | str]) -> list[str]:
    model: Any = RunConfig
    for part in location:
        fields = getattr(model, "model_fields", {})
        if part in fields:
            model = fields[part].annotation
        elif get_args(model):
            model = get_args(model)[-1]
    return list(getattr(model, "model_fields", {}))


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))
