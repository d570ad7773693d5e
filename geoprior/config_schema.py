"""What a config can say, plug-ins' options included: one JSON schema, and a page for each plug-in.

The schema is draft 2020-12, as pydantic writes it, so editors can check and complete a config with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import yaml
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from geoprior.config import KINDS, RunConfig

if TYPE_CHECKING:
    from geoprior.hooks.manager import Plugins
    from geoprior.hooks.types import Spec

LIMITS = {
    "minimum": "at least {}",
    "exclusiveMinimum": "above {}",
    "maximum": "at most {}",
    "exclusiveMaximum": "below {}",
    "multipleOf": "a multiple of {}",
    "minItems": "{} items or more",
    "maxItems": "{} items or fewer",
}


def config_schema(plugins: Plugins) -> dict[str, Any]:
    """The schema of a config file in which these plug-ins are installed.

    Where a plug-in is named it lists the names, and for each the options of that plug-in.
    """
    specs = [entry.spec for entry in plugins.registered() if entry.spec.kind in KINDS.values()]
    models = [(RunConfig, "validation"), *((spec.config, "validation") for spec in specs)]
    references, schema = models_json_schema(list(dict.fromkeys(models)))  # type: ignore[arg-type]
    shared = schema["$defs"]
    definitions = {
        spec.kind: {"anyOf": [{"type": "string", "enum": list(plugins.names(spec.kind))}]} for spec in specs
    }
    for spec in specs:
        options = _followed(references[spec.config, "validation"], shared)
        definitions[spec.kind]["anyOf"].append(_with_name(spec, options))
    root = _followed(references[RunConfig, "validation"], shared)
    for keys, kind in KINDS.items():
        _point(_property(root, keys, shared), {"$ref": f"#/$defs/{kind}"})
    root["properties"]["extends"] = {
        "type": "string",
        "description": "Another config, packaged or beside this file, that this one is laid over.",
    }
    return {**root, "$defs": shared | definitions}


def option_lines(spec: Spec) -> list[str]:
    """A plug-in for reading: what it is, and every option with default, limits and meaning."""
    return [f"{spec.kind} {spec.name}: {spec.summary}", *_lines(spec.config, {}, "")]


def _lines(model: type[BaseModel], values: Mapping[str, Any], prefix: str) -> Iterator[str]:
    """Of each option; a value stands for the model's own default."""
    properties = model.model_json_schema().get("properties", {})
    for name, field in model.model_fields.items():
        default = values.get(name, field.get_default(call_default_factory=True, validated_data={}))
        if isinstance(default, BaseModel):
            yield from _lines(type(default), dict(default), f"{prefix}{name}.")
            continue
        shown = "(to be given)" if field.is_required() else _inline(default)
        limits = ", ".join(_limits(properties[name]))
        yield f"  {prefix}{name}: {shown}" + (f"  [{limits}]" if limits else "")
        if field.description:
            yield f"      {field.description}"


def _limits(schema: Mapping[str, Any]) -> Iterator[str]:
    """What a value must obey, in words; alternatives, as of an optional number, one after the other."""
    if "enum" in schema:
        yield "one of " + ", ".join(map(_inline, schema["enum"]))
    for key, words in LIMITS.items():
        if key in schema:
            yield words.format(schema[key])
    for alternative in schema.get("anyOf", ()):
        yield from _limits(alternative)


def _inline(value: object) -> str:
    dumped = value.model_dump(mode="json") if isinstance(value, BaseModel) else value
    plain = list(dumped) if isinstance(dumped, tuple) else dumped
    text: str = yaml.safe_dump(plain, default_flow_style=True, sort_keys=False, width=10_000)
    return text.removesuffix("...\n").strip()


def _with_name(spec: Spec, options: Mapping[str, Any]) -> dict[str, Any]:
    """The mapping that a user writes: ``name`` and the options beside it."""
    name = {"const": spec.name, "description": spec.summary}
    return {
        **options,
        "title": f"{spec.kind} {spec.name}",
        "type": "object",
        "properties": {"name": name, **options.get("properties", {})},
        "required": ["name", *options.get("required", [])],
        "additionalProperties": False,
    }


def _property(root: dict[str, Any], keys: tuple[str, ...], shared: dict[str, Any]) -> dict[str, Any]:
    node = root
    for key in keys:
        node = _followed(node, shared)["properties"][key]
    return node


def _followed(node: dict[str, Any], shared: dict[str, Any]) -> dict[str, Any]:
    """The object behind a reference, or behind an optional one."""
    for alternative in node.get("anyOf", ()):
        if "$ref" in alternative:
            node = alternative
    if "$ref" in node:
        found: dict[str, Any] = shared[node["$ref"].rsplit("/", 1)[1]]
        return found
    return node


def _point(node: dict[str, Any], reference: dict[str, Any]) -> None:
    """Let a property, or the items of a list, refer to something else."""
    target = node["items"] if node.get("type") == "array" else node
    target.update(reference)
