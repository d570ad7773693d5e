"""What a plug-in's failure is called: whose it is, where it was raised, what to do about it."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Iterable
from dataclasses import FrozenInstanceError
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from pydantic import ValidationError

from geoprior import __version__
from geoprior.errors import PluginError
from geoprior.hooks.plugin import ALLOW_LIST, Plugin

PROJECT = "geoprior"
_FROZEN = "frozen_instance"
_LINE = re.compile(r'File "(.+?)", line (\d+)')


def failed(plugin: Plugin, doing: str, error: BaseException) -> PluginError:
    """The error to raise for what a plug-in has raised.

    Args:
        plugin: Whose fault it is.
        doing: What was called, for example ``geoprior_primitives`` or ``the factory of robot 'panda'``.
        error: What it raised.
    """
    return PluginError(f"{plugin}: {doing} raised {describe(error)}", remedy(plugin, error))


def blamed(error: BaseException, found: Iterable[Plugin]) -> PluginError | None:
    """The error in the name of the plug-in whose code raised it, in this process or in a worker; or None.

    Args:
        error: Raised after the plug-in's factory had done its work, for example by what it built.
        found: Plug-ins that are not built in.
    """
    lines = _LINE.findall("".join(traceback.format_exception(error)))
    for file, number in reversed(lines):
        for plugin in found:
            if _is_of(Path(file), plugin):
                text = f"{plugin} raised {_first_line(error)} ({Path(file).name}, line {number})"
                return PluginError(text, remedy(plugin, error))
    return None


def describe(error: BaseException) -> str:
    """An exception in one line: its type, the first line of its text, and the place that raised it."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not _imports(frame.filename)]
    if not frames or isinstance(error, SyntaxError):  # which says the place itself
        return _first_line(error)
    return f"{_first_line(error)} ({Path(frames[-1].filename).name}, line {frames[-1].lineno})"


def remedy(plugin: Plugin, error: BaseException) -> str:
    """What the user can do about it."""
    if _writes_to_a_frozen_object(error):
        advice = "specs, options and events are frozen: the plug-in must make a changed copy instead"
    elif (wanted := required(plugin)) is not None and not accepts(wanted):
        advice = f"it is for geoprior {wanted.specifier}, and this is {__version__}"
    elif isinstance(error, (ImportError, TypeError, AttributeError)):
        advice = f"it may lack a dependency, or be written for another geoprior than {__version__}"
    else:
        advice = "this is a defect of that package"
    return f"{advice}; {without(plugin)}"


def required(plugin: Plugin) -> Requirement | None:
    """Which geoprior the metadata of a plug-in's package ask for, if they do."""
    try:
        texts = metadata.requires(plugin.package) or []
    except (metadata.PackageNotFoundError, ValueError):
        return None
    wanted = (Requirement(text) for text in texts)
    return next((each for each in wanted if each.name == PROJECT), None)


def accepts(wanted: Requirement) -> bool:
    """Whether this geoprior will do."""
    return wanted.specifier.contains(__version__, prereleases=True)


def without(plugin: Plugin) -> str:
    """How to get a newer version of a plug-in, or to get rid of it."""
    return (
        f"`pip install --upgrade {plugin.package}` or `pip uninstall {plugin.package}`, "
        f"or leave it out of {ALLOW_LIST}"
    )


def _imports(file: str) -> bool:
    """Whether a source file is of the machinery that imports plug-ins."""
    return "importlib" in file or Path(file).parent == Path(__file__).parent


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ": ".join([type(error).__name__, *lines[:1]])


def _is_of(file: Path, plugin: Plugin) -> bool:
    """Whether a source file belongs to a plug-in's module, or to the package that the module heads."""
    module = sys.modules.get(plugin.module.partition(":")[0])
    source = getattr(module, "__file__", None)
    if source is None:
        return False
    return file == Path(source) or (
        Path(source).name == "__init__.py" and Path(source).parent in file.parents
    )


def _writes_to_a_frozen_object(error: BaseException) -> bool:
    if isinstance(error, ValidationError):
        return any(fault["type"] == _FROZEN for fault in error.errors())
    return isinstance(error, FrozenInstanceError)
