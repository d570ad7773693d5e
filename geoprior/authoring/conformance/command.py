"""`geoprior plugins check`: find a package's plug-ins, run every check, say what came of it."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

from packaging.utils import canonicalize_name

from geoprior.authoring.conformance.package import examine_package
from geoprior.authoring.conformance.suite import FAILED, NOT_RUN, Finding, examine
from geoprior.errors import PluginError
from geoprior.hooks.manager import GROUP, Plugins
from geoprior.hooks.plugin import Plugin

_MARKS = {FAILED: "FAIL", NOT_RUN: "  - "}


def check(name: str, plugins: Plugins, say: Callable[[str], None], *, slow: bool = True) -> dict[str, Any]:
    """Check everything that a package, or one of its entry points, offers.

    Args:
        name: Of a distribution or of an entry point; ``geoprior`` checks the built-ins.
        plugins: Where it is looked up.
        say: Gets the lines to read, as the checks end.
        slow: Whether to run what simulates or trains as well.

    Returns:
        What `--json` prints: package, version, every finding, and how many failed.

    Raises:
        PluginError: No installed plug-in bears the name.
    """
    chosen = find_plugins(name, plugins)
    findings: list[Finding] = []
    for finding in _findings(chosen, plugins, slow=slow):
        if not findings or findings[-1].subject != finding.subject:
            say(f"{finding.subject} ({finding.hook})" if finding.hook else finding.subject)
        for line in as_lines(finding):
            say(line)
        findings.append(finding)
    return {
        "package": chosen[0].package,
        "version": chosen[0].version,
        "checks": len(findings),
        "failed": sum(finding.status == FAILED for finding in findings),
        "findings": [asdict(finding) for finding in findings],
    }


def find_plugins(name: str, plugins: Plugins) -> list[Plugin]:
    """The plug-ins that a name stands for.

    Raises:
        PluginError: There is none.
    """
    chosen = [
        plugin
        for plugin in plugins.found
        if name == plugin.name or canonicalize_name(name) == canonicalize_name(plugin.package)
    ]
    if chosen:
        return chosen
    names = sorted({plugin.package for plugin in plugins.found} | {p.name for p in plugins.found})
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    packages = ", ".join(sorted({plugin.package for plugin in plugins.found}))
    raise PluginError(
        f"no plug-in of geoprior is installed as {name!r}",
        f"{hint}installed: {packages}; `pip install -e FOLDER` installs one that you write",
    )


def as_lines(finding: Finding) -> Iterator[str]:
    """A finding to be read."""
    text = f": {finding.text}" if finding.text else ""
    yield f"  {_MARKS.get(finding.status, 'ok  ')} {finding.check}{text}"
    if finding.remedy:
        yield f"         {finding.remedy}"


def _findings(chosen: list[Plugin], plugins: Plugins, *, slow: bool) -> Iterator[Finding]:
    for plugin in chosen:
        if plugin.package != GROUP:
            yield from examine_package(plugin)
        for entry in plugins.registered():
            if entry.plugin == plugin:
                yield from examine(entry.spec, slow=slow)
