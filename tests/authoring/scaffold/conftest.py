"""New packages, and environments of their own to install them into."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

OFFLINE = ("--quiet", "--no-deps", "--no-index", "--no-build-isolation")
"""What pip is told so that it takes what is here and asks nobody."""


class Environment:
    """A fresh virtual environment that sees the packages of this one and nobody's plug-ins.

    Args:
        folder: Where it is made.
    """

    def __init__(self, folder: Path) -> None:
        venv.create(folder, with_pip=False)
        self.python = folder / "bin" / "python"
        here = sysconfig.get_paths()["purelib"]
        (self.site,) = folder.glob("lib/python*/site-packages")
        (self.site / "outer.pth").write_text(f"import site; site.addsitedir({here!r})\n")

    def run(self, program, *arguments, cwd=None):
        """Run `geoprior`, `pip` or `pytest` there."""
        offline = OFFLINE if (program, *arguments[:1]) == ("pip", "install") else ()
        command = [self.python, "-m", program, *arguments[:1], *offline, *arguments[1:]]
        clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        return subprocess.run(
            list(map(str, command)), cwd=cwd, env=clean, capture_output=True, text=True, check=False
        )

    def do(self, program, *arguments, cwd=None):
        """The same, which must succeed; returns what it printed."""
        done = self.run(program, *arguments, cwd=cwd)
        assert done.returncode == 0, f"{program} {arguments}\n{done.stdout}\n{done.stderr}"
        return done.stdout


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    assert sys.prefix != sys.base_prefix, "run the tests in the development environment"
    return Environment(tmp_path_factory.mktemp("environment") / "venv")
