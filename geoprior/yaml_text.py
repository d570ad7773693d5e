"""YAML as people mean it today: numbers and truth values of YAML 1.2's core schema, no key twice.

PyYAML reads YAML 1.1: ``yes`` is a truth value, ``010`` is eight, ``1:30`` is ninety and ``1e2`` is text.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

_MERGE = "tag:yaml.org,2002:merge"
_DIGITS = 40
"""Of a whole number, at most: no option needs more, and Python refuses thousands with an error of its own."""
_SCALARS: tuple[tuple[str, str, str], ...] = (
    ("null", r"~|null|Null|NULL|", "~nN\0"),
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        "-+0123456789.",
    ),
)
"""Type, how it is written, and what it may begin with; the first that fits is taken."""


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's way


class _Dumper(yaml.SafeDumper):
    """Quotes what one of both versions would take for something else than text."""


for _type, _pattern, _first in _SCALARS:
    _known = re.compile(f"^(?:{_pattern})$")
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(
            f"tag:yaml.org,2002:{_type}", _known, [character.strip("\0") for character in _first]
        )
_Loader.add_implicit_resolver(_MERGE, re.compile("^<<$"), ["<"])
_Dumper.add_implicit_resolver(_MERGE, re.compile("^<<$"), ["<"])


def _whole_number(loader: _Loader, node: yaml.ScalarNode) -> int:
    text = str(loader.construct_scalar(node))
    if len(text) > _DIGITS:
        raise yaml.MarkedYAMLError(problem=f"a number of {len(text)} digits", problem_mark=node.start_mark)
    return int(text, 0) if text.startswith(("0o", "0x")) else int(text)


def _number(loader: _Loader, node: yaml.ScalarNode) -> float:
    text = str(loader.construct_scalar(node)).lower()
    return float(text.replace(".inf", "inf").replace(".nan", "nan"))


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: list[Any] = []
    for key_node, _ in node.value:
        if key_node.tag == _MERGE:
            continue
        key = loader.construct_object(key_node, deep=True)
        if key in seen:
            raise yaml.MarkedYAMLError(problem=f"key {key!r} twice", problem_mark=key_node.start_mark)
        seen.append(key)
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:int", _whole_number)
_Loader.add_constructor("tag:yaml.org,2002:float", _number)
_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def parse_yaml(text: str) -> Any:
    """Read a document; ``<<`` merges as in YAML 1.1, which many files use.

    Raises:
        yaml.YAMLError: It is not YAML, has a key twice, a number of too many digits, or is nested too deeply.
    """
    try:
        return yaml.load(text, Loader=_Loader)  # noqa: S506 - a safe loader
    except RecursionError:
        raise yaml.YAMLError("nested too deeply") from None


def to_text(tree: Any) -> str:
    """Write a tree so that `parse_yaml` gives it back; keys stay in order."""
    return str(yaml.dump(tree, Dumper=_Dumper, sort_keys=False, width=100))
