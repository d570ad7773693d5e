"""Find plug-ins, check them, and build what they offer by name.

Built-ins are the modules of the packages named in `BUILTIN_PACKAGES`; they register through the same
hooks as everybody else. Third-party packages are found by the entry-point group ``geoprior``.
"""

from __future__ import annotations

import difflib
import importlib
import inspect
import os
import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from types import ModuleType
from typing import Any

import pluggy
from pydantic import BaseModel, ValidationError

from geoprior import __version__
from geoprior.errors import ConfigError, PluginError
from geoprior.hooks import specs
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
ALLOW_LIST = "GEOPRIOR_PLUGINS"
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


@dataclass(frozen=True)
class Plugin:
    """One plug-in module as found.

    Attributes:
        name: Entry-point name, or the module's path for a built-in.
        package: Distribution that ships it.
        version: Of that distribution.
        status: ``ok``, ``broken`` or ``not allowed``.
        hooks: Names of the hooks that it implements.
        error: Why it is broken, one line.
    """

    name: str
    package: str
    version: str
    status: str
    hooks: tuple[str, ...] = ()
    error: str = ""


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

    @property
    def found(self) -> tuple[Plugin, ...]:
        """Every plug-in seen, broken ones and those not allowed among them, sorted by package."""
        return tuple(sorted(self._found, key=lambda plugin: (plugin.package, plugin.name)))

    @property
    def hook(self) -> pluggy.HookRelay:
        """The event hooks, to be called with keyword arguments."""
        return self._manager.hook

    def load_builtins(self) -> None:
        """Register every module of the built-in packages that implements a hook."""
        for package in BUILTIN_PACKAGES:
            for name in _module_names(package):
                module = importlib.import_module(name)
                if _hooks_of(module):
                    self.register(module, name=name, package=GROUP, version=__version__)

    def load_entry_points(self) -> None:
        """Load third-party plug-ins, each in its own try; ``GEOPRIOR_PLUGINS`` is the allow-list."""
        allowed = _allow_list()
        for point in sorted(metadata.entry_points(group=GROUP), key=lambda point: point.name):
            package, version = _distribution(point)
            if allowed is not None and point.name not in allowed:
                self._found.append(Plugin(point.name, package, version, "not allowed"))
                continue
            try:
                self.register(point.load(), name=point.name, package=package, version=version)
            except PluginConflictError:
                raise
            except Exception as error:  # noqa: BLE001 - a stranger's module may raise anything
                text = f"{type(error).__name__}: {error}".splitlines()[0]
                self._found.append(Plugin(point.name, package, version, "broken", error=text))

    def register(self, module: object, *, name: str, package: str, version: str) -> None:
        """Register one plug-in and what it yields.

        Raises:
            PluginError: A hook is misspelt or has wrong arguments, a spec is not of its hook's type, or
                its name is taken; the message names both packages.
        """
        plugin = Plugin(name, package, version, "ok", hooks=tuple(_hooks_of(module)))
        self._refuse_unknown_hooks(plugin)
        try:
            self._manager.register(module, name=name)
            self._manager.check_pending()
        except (pluggy.PluginValidationError, ValueError) as error:
            if self._manager.has_plugin(name):
                self._manager.unregister(name=name)
            raise PluginError(
                f"plug-in {name!r} of package {package!r}: {error}", "mend or uninstall it"
            ) from error
        try:
            self._collect(plugin, module)
        except PluginError:
            self._manager.unregister(name=name)
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
            list_ = ", ".join(f"{plugin.name} ({plugin.error or plugin.status})" for plugin in broken)
            hint += f"plug-ins that did not load: {list_}; "
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
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(str(part) for part in first["loc"])
            known = ", ".join(model.model_fields) or "none"
            raise ConfigError(
                f"{kind} {choice.name!r}: option {key!r}: {first['msg']}", f"its options: {known}"
            ) from error

    def resolve(self, kind: str, choice: Choice) -> Choice:
        """The same choice with every option written out."""
        return Choice(name=choice.name, options=self.options(kind, choice).model_dump(mode="json"))

    def build(self, kind: str, choice: Choice, *arguments: object) -> Any:
        """Build what a choice names: ``factory(config, *arguments)``."""
        config = self.options(kind, choice)
        return self.spec(kind, choice.name).factory(config, *arguments)

    def _refuse_unknown_hooks(self, plugin: Plugin) -> None:
        known = [name for name, _ in inspect.getmembers(specs) if name.startswith(f"{GROUP}_")]
        for name in plugin.hooks:
            if name in known:
                continue
            near = difflib.get_close_matches(name, known, n=1)
            raise PluginError(
                f"plug-in {plugin.name!r} of package {plugin.package!r}: unknown hook {name!r}",
                f"did you mean {near[0]!r}?" if near else f"hooks: {', '.join(known)}",
            )

    def _collect(self, plugin: Plugin, module: object) -> None:
        fresh: dict[tuple[str, str], Registered] = {}
        for hook, spec_type in SPEC_OF_HOOK.items():
            if hook not in plugin.hooks:
                continue
            for spec in getattr(module, hook)():
                self._check_spec(plugin, hook, spec, spec_type)
                key = (spec.kind, spec.name)
                other = fresh.get(key) or self._registry.get(key)
                if other is not None:
                    raise PluginConflictError(
                        f"{spec.kind} {spec.name!r} is registered twice: by package "
                        f"{other.plugin.package!r} ({other.plugin.name}) and by package "
                        f"{plugin.package!r} ({plugin.name})",
                        f"uninstall one of them, or name the wanted plug-ins in {ALLOW_LIST}",
                    )
                fresh[key] = Registered(spec, plugin)
        self._registry.update(fresh)

    def _check_spec(self, plugin: Plugin, hook: str, spec: object, spec_type: type[Spec]) -> None:
        if not isinstance(spec, spec_type):
            raise PluginError(
                f"plug-in {plugin.name!r} of package {plugin.package!r}: {hook} yielded "
                f"{type(spec).__name__}, expected {spec_type.__name__}"
            )


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
        if not info.ispkg and not info.name.startswith("_"):
            yield f"{package}.{info.name}"


def _hooks_of(module: object) -> list[str]:
    marker = f"{GROUP}_impl"
    members: Mapping[str, Any] = (
        vars(module)
        if isinstance(module, ModuleType)
        else {name: getattr(module, name) for name in dir(module)}
    )
    return sorted(name for name, member in members.items() if hasattr(member, marker))


def _allow_list() -> frozenset[str] | None:
    text = os.environ.get(ALLOW_LIST)
    if text is None:
        return None
    return frozenset(name.strip() for name in text.split(",") if name.strip())


def _distribution(point: metadata.EntryPoint) -> tuple[str, str]:
    if point.dist is None:
        return point.value, "unknown"
    return point.dist.name, point.dist.version
