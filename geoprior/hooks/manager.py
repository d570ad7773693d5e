"""Find plug-ins, check them, and build what they offer by name.

Built-ins are the modules of the packages named in `BUILTIN_PACKAGES`; they register through the same
hooks as everybody else. Third-party packages are found by the entry-point group ``geoprior``.
"""

from __future__ import annotations

import difflib
import importlib
import os
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import metadata
from typing import Any

import pluggy
from pydantic import BaseModel, ValidationError

from geoprior import __version__
from geoprior.errors import ConfigError, GeopriorError, PluginError
from geoprior.hooks import specs
from geoprior.hooks.door import hooks_of, refuse_unknown_hooks, specs_of
from geoprior.hooks.events import guarded
from geoprior.hooks.failures import describe, failed, remedy, without
from geoprior.hooks.plugin import ALLOW_LIST, Plugin
from geoprior.hooks.types import (
    ExecutorSpec,
    LookSpec,
    MotionSpec,
    PolicySpec,
    PrimitiveSpec,
    RendererSpec,
    RobotSpec,
    SourceSpec,
    Spec,
    TaskSpec,
    VariantSpec,
)
from geoprior.options import Choice

GROUP = "geoprior"
BUILTIN_PACKAGES = (
    "geoprior.scene.primitives",
    "geoprior.motions",
    "geoprior.render.variants",
    "geoprior.render",
    "geoprior.sources",
    "geoprior.policies.act",
    "geoprior.training.loggers",
    "geoprior.sim.robots",
    "geoprior.sim.tasks",
    "geoprior.sim.looks",
    "geoprior.executors",
)
SPEC_OF_HOOK: dict[str, type[Spec]] = {
    "geoprior_primitives": PrimitiveSpec,
    "geoprior_motions": MotionSpec,
    "geoprior_variants": VariantSpec,
    "geoprior_renderers": RendererSpec,
    "geoprior_sources": SourceSpec,
    "geoprior_robots": RobotSpec,
    "geoprior_tasks": TaskSpec,
    "geoprior_looks": LookSpec,
    "geoprior_policies": PolicySpec,
    "geoprior_executors": ExecutorSpec,
}
HOOK_OF_KIND = {spec.kind: hook for hook, spec in SPEC_OF_HOOK.items()}
"""The kinds of plug-ins, and the hook that registers each."""


@dataclass(frozen=True)
class Registered:
    """A spec and the plug-in that it came from."""

    spec: Spec
    plugin: Plugin


class Plugins:
    """The plug-ins of one process. Use `plugins` unless you test."""

    def __init__(self) -> None:
        self._manager = pluggy.PluginManager(GROUP)
        self._manager.add_hookspecs(specs)
        self._found: list[Plugin] = []
        self._registry: dict[tuple[str, str], Registered] = {}
        self.unmatched: tuple[str, ...] = ()
        """Names of the allow-list that nothing installed bears."""

    @property
    def found(self) -> tuple[Plugin, ...]:
        """Every plug-in seen, broken ones and those not allowed among them, sorted by package."""
        return tuple(sorted(self._found, key=lambda plugin: (plugin.package, plugin.name)))

    @property
    def hook(self) -> pluggy.HookRelay:
        """The event hooks, to be called with keyword arguments."""
        return self._manager.hook

    def load_builtins(self) -> None:
        """Register every module of the built-in packages, or package in them, that implements a hook."""
        for package in BUILTIN_PACKAGES:
            for name in _module_names(package):
                module = importlib.import_module(name)
                if hooks_of(module):
                    self.register(module, name=name, package=GROUP, version=__version__)

    def load_entry_points(self) -> None:
        """Load third-party plug-ins, each in its own try.

        ``GEOPRIOR_PLUGINS`` is the allow-list: names of entry points, or of packages for all of theirs.
        """
        allowed = _allow_list()
        points = sorted(metadata.entry_points(group=GROUP), key=lambda point: point.name)
        borne = {name for point in points for name in (point.name, _distribution(point)[0])}
        self.unmatched = tuple(sorted((allowed or frozenset()) - borne))
        for point in points:
            plugin = Plugin(point.name, *_distribution(point), "ok", module=point.value)
            if allowed is not None and allowed.isdisjoint((plugin.name, plugin.package)):
                self._found.append(replace(plugin, status="not allowed"))
                continue
            try:
                self._register(point.load(), plugin)
            except PluginConflictError:
                raise
            except PluginError as error:
                fault = error.message.removeprefix(f"{plugin}: ")
                self._found.append(replace(plugin, status="broken", error=fault, remedy=error.hint))
            except (Exception, SystemExit) as error:  # noqa: BLE001 - a stranger's module may raise anything
                fault, hint = describe(error), remedy(plugin, error)
                self._found.append(replace(plugin, status="broken", error=fault, remedy=hint))

    def register(self, module: object, *, name: str, package: str, version: str) -> None:
        """Register one plug-in and what it yields.

        Raises:
            PluginError: A hook is misspelt, raises or has wrong arguments, a spec is not whole or not of its
                hook's type, or its name is taken; the message names both packages.
        """
        self._register(module, Plugin(name, package, version, "ok", module=getattr(module, "__name__", "")))

    def _register(self, module: object, plugin: Plugin) -> None:
        plugin = replace(plugin, hooks=hooks_of(module))
        refuse_unknown_hooks(plugin)
        hooks = module if plugin.package == GROUP else guarded(module, plugin)
        try:
            self._manager.register(hooks, name=f"{plugin.package} {plugin.name}")
        except (pluggy.PluginValidationError, ValueError) as error:
            if self._manager.is_registered(hooks):
                self._manager.unregister(hooks)
            raise PluginError(f"{plugin}: {error}", without(plugin)) from error
        try:
            self._collect(plugin, module)
        except PluginError:
            self._manager.unregister(hooks)
            raise
        self._found.append(plugin)

    def names(self, kind: str) -> tuple[str, ...]:
        """Registered names of one kind, sorted."""
        return tuple(sorted(name for its_kind, name in self._registry if its_kind == kind))

    def registered(self) -> tuple[Registered, ...]:
        """Everything registered, sorted by kind and name."""
        return tuple(self._registry[key] for key in sorted(self._registry))

    def spec(self, kind: str, name: str) -> Spec:
        """Look a name up.

        Raises:
            ConfigError: Nothing of that kind bears the name; the hint shows the choices and the nearest.
        """
        entry = self._registry.get((kind, name))
        if entry is not None:
            return entry.spec
        choices = self.names(kind)
        near = difflib.get_close_matches(name, choices, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        broken = [plugin for plugin in self._found if plugin.status != "ok"]
        if broken:
            list_ = ", ".join(
                f"{plugin.name} ({plugin.error or plugin.status}) of {plugin.package} {plugin.version}"
                for plugin in broken
            )
            hint += f"plug-ins that did not load (see `geoprior plugins check`): {list_}; "
        raise ConfigError(
            f"unknown {kind} {name!r}", f"{hint}choices: {', '.join(choices) or 'none are registered'}"
        )

    def plugin_of(self, kind: str, name: str) -> Plugin:
        """The plug-in that registered a name; see `spec` for unknown ones."""
        self.spec(kind, name)
        return self._registry[kind, name].plugin

    def options(self, kind: str, choice: Choice) -> BaseModel:
        """Check a choice's options against its plug-in's model.

        Raises:
            ConfigError: The name is unknown, or an option is; the message names the option.
        """
        model = self.spec(kind, choice.name).config
        try:
            return model.model_validate(choice.options)
        except Exception as error:
            if not isinstance(error, ValidationError):
                self._blame(kind, choice.name, "the config model", error)
                raise
            first = error.errors()[0]
            key = ".".join(str(part) for part in first["loc"])
            known = ", ".join(model.model_fields) or "none"
            raise ConfigError(
                f"{kind} {choice.name!r}: option {key!r}: {first['msg']}",
                f"its options: {known} (`geoprior plugins show {kind} {choice.name}` explains them)",
            ) from error

    def resolve(self, kind: str, choice: Choice) -> Choice:
        """The same choice with every option written out."""
        return Choice(name=choice.name, options=self.options(kind, choice).model_dump(mode="json"))

    def build(self, kind: str, choice: Choice, *arguments: object) -> Any:
        """Build what a choice names: ``factory(config, *arguments)``.

        Raises:
            ConfigError: The name or an option is unknown.
            PluginError: The factory of a plug-in that is not built in raises.
        """
        config = self.options(kind, choice)
        try:
            return self.spec(kind, choice.name).factory(config, *arguments)
        except Exception as error:
            self._blame(kind, choice.name, "the factory", error)
            raise

    def _blame(self, kind: str, name: str, part: str, error: Exception) -> None:
        """Raise in a plug-in's name what a part of its spec has raised; what is foreseen or ours stays."""
        plugin = self.plugin_of(kind, name)
        if plugin.package != GROUP and not isinstance(error, GeopriorError):
            raise failed(plugin, f"{part} of {kind} {name!r} ({HOOK_OF_KIND[kind]})", error) from error

    def _collect(self, plugin: Plugin, module: object) -> None:
        fresh: dict[tuple[str, str], Registered] = {}
        for hook, spec_type in SPEC_OF_HOOK.items():
            if hook not in plugin.hooks:
                continue
            for spec in specs_of(plugin, module, hook, spec_type):
                key = (spec.kind, spec.name)
                other = fresh.get(key) or self._registry.get(key)
                if other is not None:
                    raise PluginConflictError(
                        f"{spec.kind} {spec.name!r} is registered twice: by {other.plugin} and by {plugin}",
                        f"uninstall one of them, or name the wanted plug-ins in {ALLOW_LIST}",
                    )
                fresh[key] = Registered(spec, plugin)
        self._registry.update(fresh)


class PluginConflictError(PluginError):
    """Two packages register the same name: fatal, whatever the config needs."""


@lru_cache(maxsize=1)
def plugins() -> Plugins:
    """The plug-ins of this process: built-ins, then entry points."""
    found = Plugins()
    found.load_builtins()
    found.load_entry_points()
    return found


def _module_names(package: str) -> Iterator[str]:
    for info in pkgutil.iter_modules(importlib.import_module(package).__path__):
        if not info.name.startswith("_"):
            yield f"{package}.{info.name}"


def _allow_list() -> frozenset[str] | None:
    text = os.environ.get(ALLOW_LIST)
    if text is None:
        return None
    return frozenset(name.strip() for name in text.split(",") if name.strip())


def _distribution(point: metadata.EntryPoint) -> tuple[str, str]:
    if point.dist is None:
        return point.value, "unknown"
    return point.dist.name, point.dist.version
