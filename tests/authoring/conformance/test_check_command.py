"""`geoprior plugins check`: which package, version and hook, what is wrong, what to do."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from geoprior import __version__
from geoprior.authoring.conformance.command import check
from geoprior.authoring.conformance.package import HEAVY
from geoprior.errors import PluginError
from geoprior.hooks.manager import Plugins

GOOD = """
from geoprior import PrimitiveSpec, hookimpl
from geoprior.options import Options
from geoprior.scene.solids import SolidOptions, sized_solid, unit_cone
class Mug:
    def __init__(self, config):
        self.config = config
    def sample(self, rng):
        return sized_solid(unit_cone(), self.config, rng)
@hookimpl
def geoprior_primitives():
    yield PrimitiveSpec("mug", "a mug without a handle", SolidOptions, Mug)
"""


@pytest.fixture
def checked(tmp_path, monkeypatch):
    """``checked(code)``: what the check says of a package geoprior-mug 3.1 of this one module."""

    def run(code, requires="geoprior", name="geoprior-mug", **options):
        install(tmp_path, code, requires)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        monkeypatch.syspath_prepend(tmp_path)
        sys.modules.pop("geoprior_mug", None)
        plugins, lines = Plugins(), []
        plugins.load_builtins()
        plugins.load_entry_points()
        content = check(name, plugins, lines.append, **options)
        return content, "\n".join(lines)

    yield run
    sys.modules.pop("geoprior_mug", None)


def install(folder, code, requires="geoprior"):
    (folder / "geoprior_mug.py").write_text(code)
    metadata = folder / "geoprior_mug-3.1.dist-info"
    metadata.mkdir()
    needed = f"Requires-Dist: {requires}\n" if requires else ""
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: geoprior-mug\nVersion: 3.1\n{needed}")
    (metadata / "entry_points.txt").write_text("[geoprior]\nthe-mug = geoprior_mug\n")


@pytest.mark.parametrize("name", ["geoprior-mug", "geoprior_mug", "Geoprior.Mug", "the-mug"])
def test_a_package_goes_by_its_name_and_by_its_entry_points(checked, name):
    content, text = checked(GOOD, name=name)
    assert (content["package"], content["version"], content["failed"]) == ("geoprior-mug", "3.1", 0)
    assert content["checks"] == len(content["findings"]) > 10
    assert "plug-in 'the-mug' of package 'geoprior-mug' 3.1" in text
    assert "primitive mug (geoprior_primitives)" in text
    assert "FAIL" not in text


@pytest.mark.parametrize("module", [name for name in HEAVY if name in ("torch", "cv2", "robosuite")])
def test_a_heavy_import_is_named_with_its_line(checked, module):
    content, text = checked(f"{GOOD}\nimport {module}\n")
    assert content["failed"] == 1
    assert f"importing geoprior_mug imports {module}, by " in text
    assert "geoprior_mug.py:14" in text
    assert "import it inside the factory" in text


def test_a_heavy_import_by_way_of_another_module_is_laid_at_the_plug_ins_door(checked):
    _, text = checked(f"import geoprior.sim.environment\n{GOOD}")
    assert "imports mujoco, by " in text
    assert "geoprior_mug.py:1" in text


def test_a_slow_import_is_measured(checked):
    slow = "import time\nbegun = time.process_time()\nwhile time.process_time() < begun + 0.7: pass\n"
    _, text = checked(slow + GOOD)
    assert "FAIL its import is light: importing geoprior_mug takes 0.7" in text


def test_a_function_that_is_called_like_a_hook_and_is_not_marked_is_found(checked):
    content, text = checked(GOOD.replace("@hookimpl\n", ""))
    assert content["failed"] == 1
    assert "geoprior_primitives in geoprior_mug lacks @hookimpl and is never called" in text


def test_a_misspelt_hook_is_found_and_the_right_one_is_named(checked):
    content, text = checked(GOOD.replace("def geoprior_primitives", "def geoprior_primitive"))
    assert content["failed"] == 1
    assert "geoprior_mug cannot be used: unknown hook 'geoprior_primitive'" in text
    assert "did you mean 'geoprior_primitives'?" in text


def test_a_module_without_hooks_is_found(checked):
    _, text = checked("answer = 42\n")
    assert "geoprior_mug implements no hook" in text


@pytest.mark.parametrize(
    ("requires", "complaint"),
    [
        ("", "geoprior-mug does not depend on geoprior"),
        ("geoprior>=99", f"geoprior-mug 3.1 is for geoprior >=99, this is {__version__}"),
    ],
)
def test_a_package_must_say_which_geoprior_it_needs(checked, requires, complaint):
    content, text = checked(GOOD, requires)
    assert content["failed"] == 1
    assert complaint in text


def test_a_package_that_is_not_allowed_is_told_so(checked, monkeypatch):
    monkeypatch.setenv("GEOPRIOR_PLUGINS", "somebody-else")
    _, text = checked(GOOD)
    assert "GEOPRIOR_PLUGINS does not name it" in text
    assert "add 'the-mug' to it" in text


def test_an_unknown_name_shows_the_nearest(checked):
    with pytest.raises(PluginError, match="no plug-in of geoprior is installed as 'geoprior-mugs'") as caught:
        checked(GOOD, name="geoprior-mugs")
    assert "did you mean 'geoprior-mug'?" in caught.value.hint


def test_the_command_ends_with_code_3_and_says_which_package_failed(tmp_path):
    install(tmp_path, GOOD.replace("a mug without a handle", ""))
    command = [sys.executable, "-m", "geoprior", "plugins", "check", "geoprior-mug", "--json"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    content = json.loads(done.stdout)
    (failed,) = (finding for finding in content["findings"] if finding["status"] == "failed")
    assert (failed["subject"], failed["hook"]) == ("primitive mug", "geoprior_primitives")
    assert failed["text"] == "its summary is empty"
    assert failed["remedy"]
    assert "geoprior-mug 3.1: 1 of" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_checks_need_no_pytest(run_python):
    run_python(
        "import sys\n"
        "from geoprior.authoring.conformance.command import check\n"
        "from geoprior.hooks.manager import Plugins\n"
        "plugins = Plugins(); plugins.load_builtins()\n"
        "check('geoprior.scene.primitives.sphere', plugins, print)\n"
        "assert 'pytest' not in sys.modules\n"
        "assert not {'torch', 'mujoco', 'robosuite'} & set(sys.modules)\n"
    )
