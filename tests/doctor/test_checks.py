import subprocess
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from geoprior.doctor import checks
from geoprior.doctor.checks import Finding
from geoprior.errors import MachineError
from geoprior.sim import backend


def finding(name, *, good, needed=True, mend="mend it"):
    return Finding(name, good=good, text="seen", mend="" if good else mend, needed=needed)


def test_this_machine_is_fit():
    checks.require_fit(checks.examine(Path.cwd(), rendering=checks.is_simulation_installed()))


def test_a_wrong_mujoco_is_named_with_the_pip_line(monkeypatch):
    real = metadata.version
    monkeypatch.setattr(checks.metadata, "version", lambda name: "3.10.0" if name == "mujoco" else real(name))
    findings = {found.name: found for found in checks._requirements("sim")}
    assert not findings["mujoco"].good
    assert "3.10.0" in findings["mujoco"].text
    assert findings["mujoco"].mend == "pip install 'geoprior[sim]'"
    with pytest.raises(MachineError, match=r"mujoco: 3\.10\.0 is installed"):
        checks.require_fit([findings["mujoco"]])


def test_a_missing_package_is_named():
    missing = checks._requirement(Requirement("no-such-package-of-ours>=1"), "pip install it")
    assert (missing.good, missing.text, missing.mend) == (False, "not installed", "pip install it")


def test_a_machine_without_the_extra_trains_and_is_told_how_to_simulate(monkeypatch):
    """What the extra brings is missing: nothing is wrong until a stage has to simulate."""
    real = metadata.version

    def version(name):
        if name in checks.SIMULATION:
            raise metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(checks.metadata, "version", version)
    monkeypatch.setattr(checks, "render_backends", lambda: pytest.fail("nothing can be rendered"))
    checks.require_fit(checks.examine(rendering=False))
    found = {finding.name: finding for finding in checks.examine(rendering=True)}
    assert {found[name].text for name in checks.SIMULATION} == {"not installed"}
    with pytest.raises(MachineError) as caught:
        checks.require_fit(list(found.values()))
    assert caught.value.hint == "pip install 'geoprior[sim]'"
    assert not checks.without_simulation().needed


def test_simulating_without_the_extra_is_refused_in_words(monkeypatch):
    monkeypatch.setattr(backend, "find_spec", lambda name: None)
    with pytest.raises(MachineError, match="mujoco is not installed") as caught:
        backend.require_simulation()
    assert caught.value.hint == "pip install 'geoprior[sim]'"


def test_a_backend_that_cannot_render_comes_with_its_apt_line(monkeypatch):
    monkeypatch.setattr(checks, "GL_BACKENDS", {"no-such-backend": "sudo apt-get install it"})
    (found,) = checks.render_backends()
    assert not found.good
    assert found.needed
    assert found.mend == "sudo apt-get install it"


def test_a_backend_that_hangs_is_given_up(monkeypatch):
    def hang(command, **options):
        raise subprocess.TimeoutExpired(command, options["timeout"])

    monkeypatch.setattr(checks.subprocess, "run", hang)
    assert "no frame within" in checks._try_backend("egl").text


def test_one_backend_is_enough(monkeypatch):
    monkeypatch.setattr(
        checks, "_try_backend", lambda name: finding(f"GL {name}", good=name == "osmesa", mend="apt")
    )
    monkeypatch.delenv(checks.GL_VARIABLE, raising=False)
    findings = checks.render_backends()
    checks.require_fit(findings)
    assert checks.usable_backend(findings) == "osmesa"


def test_no_backend_at_all_stops_a_run(monkeypatch):
    monkeypatch.setattr(checks, "_try_backend", lambda name: finding(f"GL {name}", good=False))
    findings = checks.render_backends()
    with pytest.raises(MachineError, match="GL egl"):
        checks.require_fit(findings)
    monkeypatch.delenv(checks.GL_VARIABLE, raising=False)
    with pytest.raises(MachineError, match="no GL backend"):
        checks.usable_backend(findings)


def test_the_users_choice_of_backend_is_kept_or_refused(monkeypatch):
    findings = [finding("GL egl", good=True), finding("GL osmesa", good=False)]
    monkeypatch.setenv(checks.GL_VARIABLE, "egl")
    assert checks.usable_backend(findings) == "egl"
    monkeypatch.setenv(checks.GL_VARIABLE, "osmesa")
    with pytest.raises(MachineError, match="MUJOCO_GL=osmesa"):
        checks.usable_backend(findings)


def test_cv2_that_does_not_import_comes_with_the_pip_line(monkeypatch):
    broken = subprocess.CompletedProcess([], 1, "", "ImportError: libGL.so.1: cannot open shared object file")
    monkeypatch.setattr(checks.subprocess, "run", lambda *_, **__: broken)
    (found,) = checks._opencv()
    assert not found.good
    assert "libGL.so.1" in found.text
    assert "opencv-python-headless" in found.mend


@pytest.mark.parametrize("written", ["osmesa", "OSMESA", " osmesa "])
def test_the_named_backend_is_taken_as_mujoco_would_read_it(monkeypatch, written):
    monkeypatch.setenv(checks.GL_VARIABLE, written)
    both = [finding("GL egl", good=True), finding("GL osmesa", good=True)]
    assert checks.usable_backend(both) == "osmesa"
