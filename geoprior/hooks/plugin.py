"""A plug-in as it was found: whose it is, and whether it can be used."""

from __future__ import annotations

from dataclasses import dataclass

ALLOW_LIST = "GEOPRIOR_PLUGINS"
"""The environment variable that names the plug-ins to load; all of them without it."""


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
        module: What the entry point names, ``module`` or ``module:object``.
        remedy: What to do about it, where it is broken.
    """

    name: str
    package: str
    version: str
    status: str
    hooks: tuple[str, ...] = ()
    error: str = ""
    module: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        return f"plug-in {self.name!r} of package {self.package!r} {self.version}"
