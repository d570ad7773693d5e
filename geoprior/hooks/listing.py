"""What `geoprior plugins list` says, for people and for programs."""

from __future__ import annotations

from typing import Any

from geoprior.hooks.manager import Plugins
from geoprior.hooks.plugin import Plugin


def as_tree(plugins: Plugins) -> list[dict[str, Any]]:
    """Every plug-in found, with the specs that it registered, as JSON values."""
    return [
        {**vars(plugin), "hooks": list(plugin.hooks), "offers": _offers(plugins, plugin)}
        for plugin in plugins.found
    ]


def as_lines(plugins: Plugins) -> list[str]:
    """The same to be read: one line a name, grouped by kind, then the plug-ins that did not load."""
    lines: list[str] = []
    kind = ""
    for entry in plugins.registered():
        if entry.spec.kind != kind:
            kind = entry.spec.kind
            lines.append(f"{kind}s" if kind != "policy" else "policies")
        origin = f"{entry.plugin.package} {entry.plugin.version}"
        lines.append(f"  {entry.spec.name:<18} {entry.spec.summary}  [{origin}]")
    for plugin in plugins.found:
        if plugin.status != "ok":
            reason = plugin.error or "not in GEOPRIOR_PLUGINS"
            lines.append(f"{plugin.status}: {plugin.name} [{plugin.package} {plugin.version}]: {reason}")
    lines += [f"unknown: {name}: in GEOPRIOR_PLUGINS, and not installed" for name in plugins.unmatched]
    return lines


def _offers(plugins: Plugins, plugin: Plugin) -> list[dict[str, str]]:
    return [
        {"kind": entry.spec.kind, "name": entry.spec.name, "summary": entry.spec.summary}
        for entry in plugins.registered()
        if entry.plugin == plugin
    ]
