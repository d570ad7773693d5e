"""The command line before anything heavy: help, version, and what is imported."""

import resource
import statistics
import subprocess
import sys

import pytest
from click.testing import CliRunner

from geoprior import __version__
from geoprior.cli import cli
from geoprior.stages import STAGE_NAMES


def commands(group, path=()):
    for name, command in group.commands.items():
        yield (*path, name)
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))


def test_help_answers_fast_and_imports_nothing_heavy(run_python):
    run_python(
        "import sys\n"
        "sys.argv = ['geoprior', '--help']\n"
        "from geoprior.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: assert end.code == 0\n"
        "heavy = {'torch', 'mujoco', 'robosuite', 'numpy', 'pydantic', 'cv2'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    assert statistics.median(processor_seconds_of_help() for _ in range(5)) < 0.3


def processor_seconds_of_help():
    """User and system time: what the answer takes on a core of its own, however busy the machine is."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "geoprior", "--help"], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.parametrize("path", list(commands(cli)), ids=" ".join)
def test_every_command_explains_itself(path):
    result = CliRunner().invoke(cli, [*path, "--help"])
    assert result.exit_code == 0
    text = result.output.split("Options:")[0].splitlines()[2:]
    assert any(line.strip() for line in text)


def test_every_stage_has_a_command():
    assert set(STAGE_NAMES) <= set(cli.commands)


def test_version():
    assert __version__ in CliRunner().invoke(cli, ["--version"]).output


def run_cli(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "geoprior", *arguments], capture_output=True, text=True, check=False
    )


def test_an_unknown_command_prints_no_traceback():
    done = run_cli("generat")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "generat" in done.stderr


def test_a_missing_config_names_the_nearest():
    done = run_cli("config", "show", "quikstart")
    assert done.returncode == 2
    assert "did you mean 'quickstart'" in done.stderr
    assert "Traceback" not in done.stderr


def test_verbose_shows_the_traceback_wherever_it_stands():
    for arguments in (("--verbose", "config", "show", "quikstart"), ("config", "show", "x", "--verbose")):
        done = run_cli(*arguments)
        assert done.returncode == 2
        assert "Traceback" in done.stderr
