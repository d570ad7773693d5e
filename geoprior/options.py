"""The base of everything that a user writes: frozen, strict models, and names with options."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

_RECIPE = {"purpose": "recipe"}
"""The context of pydantic's serialisation that `recipe_tree` uses."""


class Options(BaseModel):
    """A frozen model that refuses unknown keys. Document every field: the JSON schema shows it."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    speed_only: ClassVar[frozenset[str]] = frozenset()
    """Names of the fields that never change a result: what was made with others stays good."""

    later: ClassVar[frozenset[str]] = frozenset()
    """Names of the fields that came after data had been made without them. At its default such a field does
    not enter a recipe, so that what was made before keeps its fingerprint."""

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_truth_as_number(cls, value: object, info: ValidationInfo) -> object:
        """``trials: true`` is no trial, though Python counts it as one."""
        parts = value if isinstance(value, (list, tuple)) else (value,)
        if any(isinstance(part, bool) for part in parts) and not _takes_truth(cls, str(info.field_name)):
            raise ValueError("true and false are neither numbers nor text")
        return value

    @model_serializer(mode="wrap")
    def _drop_later_defaults(
        self, dump: SerializerFunctionWrapHandler, info: SerializationInfo
    ) -> dict[str, Any]:
        tree: dict[str, Any] = dump(self)
        if info.context is not _RECIPE:
            return tree
        at_default = {
            name
            for name in self.later
            if getattr(self, name) == type(self).model_fields[name].get_default(call_default_factory=True)
        }
        return {name: value for name, value in tree.items() if name not in at_default}


@lru_cache(maxsize=4096)
def _takes_truth(model: type[BaseModel], name: str) -> bool:
    """Whether a field may be true or false, by itself or as one of several types."""
    return _names_bool(model.model_fields[name].annotation)


def _names_bool(annotation: object) -> bool:
    if annotation in (bool, Any, object):
        return True
    return any(_names_bool(part) for part in get_args(annotation))


def recipe_tree(options: BaseModel, exclude: frozenset[str] = frozenset()) -> dict[str, Any]:
    """All fields but ``exclude`` as JSON, at any depth without those of `Options.later` at their default."""
    return options.model_dump(mode="json", exclude=set(exclude), context=_RECIPE)


def deciding(options: BaseModel) -> dict[str, Any]:
    """The fields that a result depends on, as JSON: all but those named in ``speed_only``.

    As in a recipe those of `Options.later` at their default are left out.
    """
    return recipe_tree(options, frozenset(getattr(options, "speed_only", ())))


class Choice(Options):
    """A registered name and its options: ``cylinder`` or ``{name: cylinder, radius: [0.01, 0.03]}``.

    The options are checked against the plug-in's own model when the config is resolved, and the
    resolved config holds all of them.
    """

    name: str = Field(description="Registered name; `geoprior plugins list` shows the choices.")
    options: dict[str, Any] = Field(default_factory=dict, description="Options of that plug-in.")

    @model_validator(mode="before")
    @classmethod
    def _accept_short_forms(cls, value: object) -> object:
        if isinstance(value, str):
            return {"name": value}
        if isinstance(value, Mapping) and "name" in value and "options" not in value:
            return {"name": value["name"], "options": {k: v for k, v in value.items() if k != "name"}}
        return value

    @model_serializer
    def _flatten(self) -> dict[str, Any]:
        return {"name": self.name, **self.options}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe the two forms that a user may write."""
        del core_schema, handler
        name = {"type": "string", "description": cls.model_fields["name"].description}
        return {
            "description": "A registered name, or a mapping of `name` and that plug-in's options.",
            "anyOf": [
                name,
                {"type": "object", "properties": {"name": name}, "required": ["name"]},
            ],
        }
