"""The command line with the packages of a folder, as pip would have installed them there."""

from __future__ import annotations

import os
import subprocess
import sys


def geoprior(site, *arguments, **environment):
    """Run it in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "geoprior", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(site), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
