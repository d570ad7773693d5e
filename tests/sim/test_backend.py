from __future__ import annotations

import os
import subprocess
import sys

import pytest

from geoprior.errors import MachineError
from geoprior.sim import backend


def test_missing_libraries_name_the_packages(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(backend, "_loads", lambda _: False)
    with pytest.raises(MachineError, match="egl or osmesa") as caught:
        backend.choose_gl()
    assert "apt-get install libegl1" in caught.value.hint
    assert "libosmesa6" in caught.value.hint


def test_backend_that_needs_a_display_is_refused(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    with pytest.raises(MachineError, match="glfw"):
        backend.choose_gl()


def test_osmesa_is_the_second_choice(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "")
    monkeypatch.setattr(backend, "_loads", lambda name: name == "osmesa")
    assert backend.choose_gl() == "osmesa"
    assert os.environ["MUJOCO_GL"] == "osmesa"


def test_import_is_silent_and_plugins_are_light():
    script = (
        "import sys\n"
        "from geoprior.hooks.manager import plugins\n"
        "from geoprior.sim import config\n"
        "plugins().names('robot'), plugins().names('task')\n"
        "heavy = {'torch', 'mujoco', 'robosuite', 'cv2', 'numba'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "from geoprior.sim.backend import prepare_robosuite\n"
        "prepare_robosuite()\n"
        "assert 'robosuite' in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert done.stderr == ""
