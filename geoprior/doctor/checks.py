"""The doctor's checks. Each says what it found and, when that is not good, the line that mends it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from packaging.requirements import Requirement

from geoprior.doctor import remedies
from geoprior.errors import MachineError

GL_BACKENDS = {"egl": remedies.EGL, "osmesa": remedies.OSMESA}
GL_VARIABLE = "MUJOCO_GL"
PROBE_SECONDS = 120.0
FREE_BYTES = 1 << 30
SIMULATION = ("mujoco", "robosuite")


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's answer.

    Attributes:
        name: What was looked at.
        good: Whether geoprior can work with it.
        text: What was found.
        mend: The command that mends it, empty when good.
        needed: Whether a run cannot do without it.
    """

    name: str
    good: bool
    text: str
    mend: str = ""
    needed: bool = True


def examine(folder: Path | None = None, *, rendering: bool = True) -> list[Finding]:
    """Run every check.

    Args:
        folder: Where a run would write; its disk is checked too.
        rendering: Whether arms are simulated, for which the extra `sim` and GL are needed: a machine that
            trains alone may have neither.
    """
    findings = [*_requirements("sim" if rendering else ""), *_opencv()]
    if rendering and all(finding.good for finding in findings if finding.mend == remedies.SIM):
        findings += render_backends()
    if folder is not None:
        findings.append(_disk(folder))
    findings.append(_cores())
    return findings


def is_simulation_installed() -> bool:
    """Whether what the extra `sim` installs is there."""
    return all(find_spec(name) is not None for name in SIMULATION)


def without_simulation() -> Finding:
    """What the doctor says of a machine on which nothing can be simulated."""
    text = "not installed; generate, pretrain, finetune, report, shards and export work without"
    return Finding("simulation", good=False, text=text, mend=remedies.SIM, needed=False)


def require_fit(findings: Sequence[Finding]) -> None:
    """Refuse to go on with an unfit machine.

    Raises:
        MachineError: Naming the first fault and its remedy.
    """
    faults = [finding for finding in findings if finding.needed and not finding.good]
    if faults:
        more = f" (and {len(faults) - 1} more: `geoprior doctor`)" if len(faults) > 1 else ""
        raise MachineError(f"{faults[0].name}: {faults[0].text}{more}", faults[0].mend)


def usable_backend(findings: Sequence[Finding]) -> str:
    """The GL backend to use: the one that ``MUJOCO_GL`` names, else the first that rendered.

    Raises:
        MachineError: None rendered, or not the named one.
    """
    good = [finding.name.removeprefix("GL ") for finding in findings if _is_gl(finding) and finding.good]
    named = os.environ.get(GL_VARIABLE, "").strip().lower()  # MuJoCo reads it so, too
    if named:
        if named in good:
            return named
        mend = GL_BACKENDS.get(named, f"unset {GL_VARIABLE}")
        raise MachineError(f"{GL_VARIABLE}={named}: that backend does not render here", mend)
    if not good:
        raise MachineError("no GL backend renders here, and the robot's cameras need one", remedies.EGL)
    return good[0]


def render_backends() -> list[Finding]:
    """Render a frame with each GL backend, side by side, each in its own process.

    One backend is enough: when one renders, the others are not needed.
    """
    with ThreadPoolExecutor(len(GL_BACKENDS)) as pool:
        found = list(pool.map(_try_backend, GL_BACKENDS))
    any_good = any(finding.good for finding in found)
    return [Finding(f.name, f.good, f.text, f.mend, needed=not any_good) for f in found]


def _is_gl(finding: Finding) -> bool:
    return finding.name.startswith("GL ")


def _try_backend(backend: str) -> Finding:
    environment = {**os.environ, GL_VARIABLE: backend, "PYOPENGL_PLATFORM": backend}
    command = [sys.executable, "-m", "geoprior.doctor.render_probe"]
    name, mend = f"GL {backend}", GL_BACKENDS[backend]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=PROBE_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return Finding(name, good=False, text=f"no frame within {PROBE_SECONDS:.0f} s", mend=mend)
    if done.returncode == 0:
        return Finding(name, good=True, text=f"renders a 96x96 frame in {done.stdout.strip()} ms")
    lines = [line for line in done.stderr.strip().splitlines() if line.strip()]
    reason = lines[-1].strip() if lines else f"ended with code {done.returncode}"
    return Finding(name, good=False, text=reason, mend=mend)


def _requirements(extra: str = "") -> Iterator[Finding]:
    """Compare what is installed with the ranges that geoprior's own metadata declares."""
    for text in metadata.requires("geoprior") or []:
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            yield _requirement(requirement, f"pip install '{requirement}'")
        elif extra and requirement.marker.evaluate({"extra": extra}):
            yield _requirement(requirement, remedies.SIM)


def _requirement(requirement: Requirement, mend: str) -> Finding:
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return Finding(requirement.name, good=False, text="not installed", mend=mend)
    if not requirement.specifier.contains(version, prereleases=True):
        text = f"{version} is installed; geoprior needs {requirement.specifier}"
        return Finding(requirement.name, good=False, text=text, mend=mend)
    return Finding(requirement.name, good=True, text=version)


def _opencv() -> Iterator[Finding]:
    """Import OpenCV: robosuite pulls opencv-python into the same folder, and that one needs libGL."""
    code = "import cv2; print(cv2.__version__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    if done.returncode == 0:
        yield Finding("cv2", good=True, text=f"imports, {done.stdout.strip()}")
        return
    lines = done.stderr.strip().splitlines() or ["does not import"]
    yield Finding("cv2", good=False, text=lines[-1], mend=remedies.CV2)


def _disk(folder: Path) -> Finding:
    place = folder
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    text = f"{free / (1 << 30):.1f} GiB free under {place}"
    return Finding("disk", free >= FREE_BYTES, text, "" if free >= FREE_BYTES else "make room")


def _cores() -> Finding:
    cores = len(os.sched_getaffinity(0))
    return Finding("cores", good=True, text=str(cores), needed=False)
