"""Config files as trees: how YAML is read, extended, overridden and compared. It knows no model."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from geoprior.errors import ConfigError
from geoprior.yaml_text import parse_yaml


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
    raise ConfigError(f"{source}: no such config file", suggest(name, packaged, "packaged configs"))


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
        if isinstance(below, Mapping) and isinstance(value, Mapping) and not _renames(below, value):
            merged[key] = merge(below, value)
        else:
            merged[key] = value
    return merged


def apply_override(tree: Mapping[str, Any], override: str, open_keys: Collection[str] = ()) -> dict[str, Any]:
    """The tree with one ``a.b=c`` applied; list items go by number, as in ``generate.motions.0.name``.

    As in `merge`, a mapping whose ``name`` changes keeps no option of the old name.

    Args:
        tree: A config, dumped.
        override: ``KEY=VALUE``; the value is YAML.
        open_keys: Mappings whose keys the user chooses, so that one can be added.

    Raises:
        ConfigError: No ``=``, not YAML, or a key that does not exist.
    """
    key, separator, text = override.partition("=")
    if not separator or not key:
        raise ConfigError(f"--set {override}: expected KEY=VALUE", "for example --set generate.episodes=50")
    try:
        value = parse_yaml(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"--set {override}: the value is not YAML ({_problem(error)})") from error
    *parents, last = key.split(".")
    opened = _mapping_at(tree, parents) if ".".join(parents) in open_keys else None
    if opened is not None:
        key, value = ".".join(parents), {**opened, last: value}
    return dict(_replaced(tree, key.split("."), value, override))


def differences(old: Any, new: Any, prefix: str = "") -> list[str]:
    """Keys whose values differ between two trees, each as ``key: old -> new``."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        found: list[str] = []
        for key in [*old, *(key for key in new if key not in old)]:
            found += differences(old.get(key), new.get(key), f"{prefix}.{key}" if prefix else str(key))
        return found
    return [] if old == new else [f"{prefix}: {old!r} -> {new!r}"]


def suggest(name: str, choices: Iterable[str], what: str) -> str:
    """A hint that shows the choices, the nearest one first."""
    names = sorted(choices)
    near = difflib.get_close_matches(name, names, n=1)
    return (f"did you mean {near[0]!r}? " if near else "") + f"{what}: {', '.join(names)}"


def _renames(below: Mapping[str, Any], value: Mapping[str, Any]) -> bool:
    return "name" in value and value["name"] != below.get("name")


def _mapping_at(node: Any, keys: Sequence[str]) -> Mapping[str, Any] | None:
    for key in keys:
        node = node.get(key) if isinstance(node, Mapping) else None
    return node if isinstance(node, Mapping) else None


def _replaced(node: Any, keys: Sequence[str], value: Any, override: str) -> Any:
    if not keys:
        return value
    key, rest = keys[0], keys[1:]
    if isinstance(node, Mapping):
        if key not in node:
            raise ConfigError(f"--set {override}: there is no key {key!r}", suggest(key, node, "keys"))
        changed = {key: _replaced(node[key], rest, value, override)}
        return changed if _renames(node, changed) else {**node, **changed}
    if isinstance(node, list):
        if not key.isdecimal() or int(key) >= len(node):
            raise ConfigError(f"--set {override}: {key!r} is not one of the {len(node)} items, from 0")
        place = int(key)
        return [*node[:place], _replaced(node[place], rest, value, override), *node[place + 1 :]]
    raise ConfigError(f"--set {override}: there are no keys under a plain value", f"leave out {key!r}")


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        tree = parse_yaml(path.read_text(encoding="utf-8"))
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
