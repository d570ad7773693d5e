"""Where a result comes from: versions, plug-ins, machine."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

from geoprior import __version__
from geoprior.hooks.manager import Plugins

PACKAGES = (
    "torch",
    "mujoco",
    "robosuite",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "webdataset",
    "numba",
)


def versions() -> dict[str, str]:
    """Versions of geoprior, Python and the packages that can change a number."""
    found = {"geoprior": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def plugins_in_use(plugins: Plugins) -> list[dict[str, str]]:
    """Package and version of every loaded plug-in that is not built in."""
    return [
        {"name": plugin.name, "package": plugin.package, "version": plugin.version}
        for plugin in plugins.found
        if plugin.status == "ok" and plugin.package != "geoprior"
    ]


def machine() -> dict[str, Any]:
    """What the results ran on."""
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "gl": os.environ.get("MUJOCO_GL", ""),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
