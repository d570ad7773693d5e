"""What holds of a plug-in's package, whatever it offers: it loads, it is light, it says what it needs."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name

from geoprior import __version__
from geoprior.authoring.conformance.check import BrokenContractError, refuse, require
from geoprior.authoring.conformance.suite import FAILED, OK, Finding
from geoprior.hooks.door import unmarked_hooks
from geoprior.hooks.failures import accepts, required, without
from geoprior.hooks.plugin import ALLOW_LIST, Plugin

HEAVY = (
    "torch",
    "mujoco",
    "robosuite",
    "numba",
    "cv2",
    "matplotlib",
    "webdataset",
    "jax",
    "pandas",
    "tensorflow",
    "transformers",
)
"""Modules that a plug-in's import must not bring in: every command of geoprior pays for it."""

SLOWEST = 0.5
"""Seconds of a processor that a plug-in's import may take beyond what geoprior imports anyway."""

_PROBE = Path(__file__).with_name("_probe.py")


def examine_package(plugin: Plugin) -> Iterator[Finding]:
    """Check one plug-in's module and metadata; what it offers is checked elsewhere."""
    loaded = _find(plugin, "it loads", _loads)
    yield loaded
    if loaded.status == OK:
        yield _find(plugin, "it implements hooks", _implements_hooks)
        yield _find(plugin, "its import is light", _import_is_light)
        yield _find(plugin, "its package says that it needs geoprior", _needs_geoprior)


def _find(plugin: Plugin, sentence: str, run: object) -> Finding:
    assert callable(run)
    try:
        return Finding(str(plugin), sentence, OK, text=run(plugin) or "")
    except BrokenContractError as error:
        return Finding(str(plugin), sentence, FAILED, text=error.fault, remedy=error.remedy)


def _loads(plugin: Plugin) -> None:
    require(
        plugin.status != "not allowed",
        f"it is installed and {ALLOW_LIST} does not name it",
        f"unset {ALLOW_LIST}, or add {plugin.name!r} to it",
    )
    require(
        plugin.status == "ok",
        f"{plugin.module} cannot be used: {plugin.error}",
        plugin.remedy,
    )


def _implements_hooks(plugin: Plugin) -> str:
    unmarked = unmarked_hooks(resolve_name(plugin.module))
    require(
        not unmarked,
        f"{', '.join(unmarked)} in {plugin.module} lacks @hookimpl and is never called",
        "from geoprior import hookimpl, and put @hookimpl above it",
    )
    require(
        plugin.hooks,
        f"{plugin.module} implements no hook",
        "let the entry point name the module in which the functions with @hookimpl are",
    )
    return ", ".join(plugin.hooks)


def _import_is_light(plugin: Plugin) -> str:
    module = plugin.module.partition(":")[0]
    command = [sys.executable, "-P", str(_PROBE), module, *HEAVY]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        refuse(
            f"in a fresh interpreter `import {module}` fails: {done.stderr.strip().splitlines()[-1]}",
            "import in the module what it needs itself",
        )
    found = json.loads(done.stdout.splitlines()[-1])
    for name, line in found["heavy"].items():
        refuse(
            f"importing {module} imports {name}, by {line}",
            "import it inside the factory: every command of geoprior imports the module",
        )
    require(
        found["seconds"] < SLOWEST,
        f"importing {module} takes {found['seconds']:.2f} s of processor time, more than {SLOWEST:g} s",
        "import what is slow inside the factory",
    )
    return f"takes {found['seconds']:.2f} s of processor time, imports nothing heavy"


def _needs_geoprior(plugin: Plugin) -> str:
    wanted = required(plugin)
    if wanted is None:
        refuse(f"{plugin.package} does not depend on geoprior", 'add "geoprior" to its dependencies')
    require(
        accepts(wanted),
        f"{plugin.package} {plugin.version} is for geoprior {wanted.specifier}, this is {__version__}",
        without(plugin),
    )
    return str(wanted)
