"""What a plug-in must hand over to be let in: hooks that exist, and specs that are whole."""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Iterator, Mapping
from types import ModuleType
from typing import Any

from pydantic import BaseModel

from geoprior.errors import PluginError
from geoprior.hooks import specs
from geoprior.hooks.failures import failed, without
from geoprior.hooks.plugin import Plugin
from geoprior.hooks.types import Spec

NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
"""What a config may call something."""

_PREFIX = "geoprior_"
_MARK = "geoprior_impl"


def known_hooks() -> tuple[str, ...]:
    """Names of all hooks, in alphabetical order."""
    return tuple(name for name, _ in inspect.getmembers(specs) if name.startswith(_PREFIX))


def hooks_of(module: object) -> tuple[str, ...]:
    """Names of what a module marks with ``@hookimpl``, in alphabetical order."""
    return tuple(sorted(name for name, member in _members(module).items() if hasattr(member, _MARK)))


def unmarked_hooks(module: object) -> tuple[str, ...]:
    """Names of functions that are called like a hook and lack ``@hookimpl``: nobody would ever call them."""
    return tuple(
        name
        for name in known_hooks()
        if inspect.isroutine(member := _members(module).get(name)) and not hasattr(member, _MARK)
    )


def refuse_unknown_hooks(plugin: Plugin) -> None:
    """Raise on a name that is no hook's.

    Raises:
        PluginError: Naming the nearest hook.
    """
    known = known_hooks()
    for name in plugin.hooks:
        if name in known:
            continue
        near = difflib.get_close_matches(name, known, n=1)
        raise PluginError(
            f"{plugin}: unknown hook {name!r}",
            f"did you mean {near[0]!r}?" if near else f"hooks: {', '.join(known)}",
        )


def specs_of(plugin: Plugin, module: object, hook: str, spec_type: type[Spec]) -> Iterator[Spec]:
    """What a register hook yields, each spec checked.

    Raises:
        PluginError: The hook raises, or yields something that is no whole spec of its kind.
    """
    try:
        yielded = list(getattr(module, hook)())
    except PluginError:
        raise
    except (Exception, SystemExit) as error:
        raise failed(plugin, hook, error) from error
    for spec in yielded:
        fault = _fault_of(spec, spec_type)
        if fault:
            raise PluginError(f"{plugin}: {hook} yielded {fault}", without(plugin))
        yield spec


def _fault_of(spec: object, spec_type: type[Spec]) -> str:
    """What is wrong with a spec, or an empty string."""
    if not isinstance(spec, spec_type):
        return f"{type(spec).__name__}, expected {spec_type.__name__}"
    title = f"{spec.kind} {getattr(spec, 'name', None)!r}"
    for attribute in ("name", "summary", "config", "factory"):
        if not hasattr(spec, attribute):
            return f"{title} without the attribute {attribute!r}"
    if not isinstance(spec.name, str) or not NAME.fullmatch(spec.name):
        return f"{title}: a name has lower-case letters, digits and single dashes between them"
    if not isinstance(spec.summary, str):
        return f"{title}: its summary is no text"
    if not (isinstance(spec.config, type) and issubclass(spec.config, BaseModel)):
        return f"{title}: its config is no pydantic model but {spec.config!r}"
    if not callable(spec.factory):
        return f"{title}: its factory cannot be called: {spec.factory!r}"
    return ""


def _members(module: object) -> Mapping[str, Any]:
    if isinstance(module, ModuleType):
        return vars(module)
    return {name: getattr(module, name) for name in dir(module)}
