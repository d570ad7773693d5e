import ast
import subprocess
import sys
from pathlib import Path

import pytest

from geoprior.doctor import preflight, remedies

SOURCES = [Path(preflight.__file__), Path(remedies.__file__)]


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.name)
def test_it_parses_under_the_old_pythons_that_it_must_speak_to(source):
    ast.parse(source.read_text(), feature_version=(3, 7))


def test_it_runs_as_a_file_without_anything_installed():
    done = subprocess.run(
        [sys.executable, "-S", "-E", str(SOURCES[0])], capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 5), done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("attribute", "replacement", "what"),
    [
        ("OLDEST_PYTHON", (99, 0), "Python"),
        ("_has_compiler", lambda: False, "compiler"),
        ("_python_headers", lambda: Path("/no/such/Python.h"), "headers"),
        ("_has_gl", lambda: False, "GL"),
    ],
)
def test_what_is_missing_is_named_with_its_apt_line(monkeypatch, capsys, attribute, replacement, what):
    monkeypatch.setattr(preflight, attribute, replacement)
    assert preflight.main() == 5
    text = capsys.readouterr().err
    assert what in text
    assert "apt-get install" in text
