"""What holds of the spec of every kind."""

from __future__ import annotations

from pydantic import ValidationError

from geoprior.authoring.conformance.check import Check, refuse, require
from geoprior.hooks.door import NAME
from geoprior.hooks.types import Spec

_DERIVE = "derive the model from geoprior.options.Options"
LONGEST_SUMMARY = 120


def _can_be_named(spec: Spec) -> None:
    require(
        NAME.fullmatch(spec.name),
        f"the name {spec.name!r} cannot be written in a config as others are",
        "take lower-case letters, digits and single dashes between them",
    )


def _has_a_summary(spec: Spec) -> None:
    require(spec.summary.strip(), "its summary is empty", "say in one line what it is")
    require(
        len(spec.summary) <= LONGEST_SUMMARY and "\n" not in spec.summary,
        f"its summary has {len(spec.summary)} characters or more than one line",
        f"one line of at most {LONGEST_SUMMARY} characters fits into `geoprior plugins list`",
    )


def _options_are_frozen_and_strict(spec: Spec) -> None:
    settings = spec.config.model_config
    require(
        settings.get("frozen"), f"{spec.config.__name__} can be written to", f"set frozen=True: {_DERIVE}"
    )
    require(
        settings.get("extra") == "forbid",
        f"{spec.config.__name__} takes options that it does not know: a misspelt one would pass unnoticed",
        f'set extra="forbid": {_DERIVE}',
    )


def _options_are_explained(spec: Spec) -> None:
    for name, field in spec.config.model_fields.items():
        require(
            field.description,
            f"option {name!r} has no description",
            f"{name}: ... = Field(default, description='what it does, and its unit')",
        )


def _defaults_build(spec: Spec) -> None:
    try:
        config = spec.config()
    except ValidationError as error:
        names = ", ".join(".".join(map(str, fault["loc"])) for fault in error.errors())
        refuse(f"it has no options by default: {names} must be given", "give every option a default")
    again = spec.config.model_validate(config.model_dump(mode="json"))
    require(
        again == config,
        "its options come back changed from the config that a run writes down",
        "use types that JSON has, and validators that accept what they give",
    )
    spec.config.model_json_schema()


def require_own_name(spec: Spec, name: str) -> None:
    """What a spec builds is called as the spec is.

    Raises:
        BrokenContractError: It is not.
    """
    require(
        name == spec.name,
        f"{spec.kind} {spec.name!r}: the {spec.kind}'s own name is {name!r}",
        f"give both the same name: shards and reports say the {spec.kind}'s",
    )


CHECKS = (
    Check("a config can name it", _can_be_named),
    Check("its summary is one line", _has_a_summary),
    Check("its options are frozen and strict", _options_are_frozen_and_strict),
    Check("its options are explained", _options_are_explained),
    Check("its defaults build and come back from JSON", _defaults_build),
)
