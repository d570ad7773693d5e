"""Which checks there are for a spec, and what comes of running them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module

from geoprior.authoring.conformance import common
from geoprior.authoring.conformance.check import BrokenContractError, Check
from geoprior.errors import GeopriorError, MachineError
from geoprior.hooks.failures import describe
from geoprior.hooks.manager import HOOK_OF_KIND
from geoprior.hooks.types import Spec

OK, FAILED, NOT_RUN = "ok", "failed", "not run"


@dataclass(frozen=True)
class Finding:
    """What came of one check.

    Attributes:
        subject: What was checked, for example ``primitive torus``.
        check: The sentence that must hold.
        status: `OK`, `FAILED`, or `NOT_RUN` where the machine cannot do it.
        text: What is wrong, or a measurement.
        remedy: What the author must do about it.
        seconds: Wall time that the check took.
        hook: What registered the subject; empty where it is a package.
    """

    subject: str
    check: str
    status: str
    text: str = ""
    remedy: str = ""
    seconds: float = 0.0
    hook: str = ""


def checks_of(spec: Spec) -> tuple[Check, ...]:
    """The checks for a spec: those of every kind, then those of its own."""
    module = import_module(f"geoprior.authoring.conformance.kinds.{spec.kind}")
    own: tuple[Check, ...] = module.CHECKS
    return common.CHECKS + own


def examine(spec: Spec, *, slow: bool = True) -> Iterator[Finding]:
    """Run a spec's checks, one after the other."""
    for check in checks_of(spec):
        if slow or not check.slow:
            yield find(spec, check)


def find(spec: Spec, check: Check) -> Finding:
    """Run one check."""
    subject, begun = f"{spec.kind} {spec.name}", time.monotonic()
    status, text, remedy = OK, "", ""
    try:
        check.run(spec)
    except BrokenContractError as error:
        status, text, remedy = FAILED, error.fault, error.remedy
    except MachineError as error:
        status, text, remedy = NOT_RUN, error.message, error.hint
    except GeopriorError as error:
        status, text, remedy = FAILED, error.message, error.hint
    except Exception as error:  # noqa: BLE001 - a stranger's plug-in may raise anything
        status, text, remedy = FAILED, f"it raised {describe(error)}", "mend what raises at that line"
    seconds = round(time.monotonic() - begun, 3)
    return Finding(subject, check.sentence, status, text, remedy, seconds, HOOK_OF_KIND[spec.kind])
