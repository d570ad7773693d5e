"""The base of everything that a user writes: frozen, strict models, and names with options."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema


class Options(BaseModel):
    """A frozen model that refuses unknown keys. Document every field: the JSON schema shows it."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    speed_only: ClassVar[frozenset[str]] = frozenset()
    """Names of the fields that never change a result: what was made with others stays good."""


def deciding(options: BaseModel) -> dict[str, Any]:
    """The fields that a result depends on, as JSON: all but those named in ``speed_only``."""
    return options.model_dump(mode="json", exclude=set(getattr(options, "speed_only", ())))


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
