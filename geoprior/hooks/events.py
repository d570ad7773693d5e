"""Event hooks of strangers: what one of them raises is said, and ends neither a training nor a run.

An event tells what has happened and can change no result. Whoever wants to stop a run raises a
`geoprior.errors.GeopriorError`, which passes.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from geoprior.errors import GeopriorError
from geoprior.hooks.failures import describe, without
from geoprior.hooks.plugin import Plugin

_log = logging.getLogger(__name__)


def guarded(module: object, plugin: Plugin) -> SimpleNamespace:
    """The plug-in's hooks as an object for pluggy, each with a guard around it."""
    return SimpleNamespace(**{name: _guard(getattr(module, name), plugin, name) for name in plugin.hooks})


def _guard(function: Callable[..., Any], plugin: Plugin, hook: str) -> Callable[..., Any]:
    silenced = False

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        nonlocal silenced
        if silenced:
            return None
        try:
            return function(*arguments)
        except GeopriorError:
            raise
        except Exception as error:  # noqa: BLE001 - a stranger's hook may raise anything
            silenced = True
            _log.warning(
                "warning: %s: %s raised %s\n  hint: the run goes on and does not call it again; %s",
                plugin,
                hook,
                describe(error),
                without(plugin),
            )
            return None

    return call
