"""For authors of plug-ins: the contract of each kind as tests, and a manager that sees nobody else.

A package's whole test of the contract::

    import pytest
    import geoprior_mug
    from geoprior.authoring.testing import cases

    @pytest.mark.parametrize("case", cases(geoprior_mug))
    def test_it_keeps_the_contract(case):
        case.check()

It is a pytest plug-in too: ``pytest_plugins = ["geoprior.authoring.testing"]`` in a ``conftest.py`` gives the
fixture `fresh_plugins`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import pytest

from geoprior.authoring.conformance.check import BrokenContractError, Check
from geoprior.authoring.conformance.suite import checks_of
from geoprior.errors import MachineError
from geoprior.hooks.manager import Plugins

if TYPE_CHECKING:
    from _pytest.mark.structures import ParameterSet

    from geoprior.hooks.types import PrimitiveSpec, Spec
    from geoprior.scene.mesh import Mesh


@pytest.fixture
def fresh_plugins() -> Plugins:
    """A manager with the built-ins only; register your module on it."""
    found = Plugins()
    found.load_builtins()
    return found


@dataclass(frozen=True)
class Case:
    """One sentence of a contract, and the spec of which it must hold."""

    spec: Spec
    sentence: Check

    def check(self) -> None:
        """Fail the test with what is wrong and what to do; skip it where the machine cannot run it."""
        __tracebackhide__ = True
        try:
            self.sentence.run(self.spec)
        except BrokenContractError as error:
            pytest.fail(f"{self.sentence}: {error.fault}\n  {error.remedy}".rstrip(), pytrace=False)
        except MachineError as error:
            pytest.skip(str(error))


def cases(*modules: ModuleType) -> list[ParameterSet]:
    """A case for each sentence of each spec that plug-in modules offer, for `pytest.mark.parametrize`.

    The modules need not be installed. Those that simulate or train are marked ``slow``.

    Args:
        modules: With their hooks.

    Raises:
        PluginError: A module cannot be registered beside the built-ins, for example as its name is taken.
    """
    found = Plugins()
    found.load_builtins()
    for module in modules:
        found.register(module, name=module.__name__, package=module.__name__, version="under test")
    names = {module.__name__ for module in modules}
    return cases_of(entry.spec for entry in found.registered() if entry.plugin.package in names)


def cases_of(specs: Iterable[Spec]) -> list[ParameterSet]:
    """The same for specs."""
    return [
        pytest.param(
            Case(spec, check),
            id=f"{spec.kind} {spec.name}: {check}",
            marks=[pytest.mark.slow] if check.slow else [],
        )
        for spec in specs
        for check in checks_of(spec)
    ]


def assert_conforms(spec: Spec, *, slow: bool = True) -> None:
    """Check a spec with its default options against the whole contract of its kind.

    Raises:
        AssertionError: Naming the spec, the seed and the fault.
    """
    for check in checks_of(spec):
        if slow or not check.slow:
            check.run(spec)


def assert_primitive_conforms(spec: PrimitiveSpec, seeds: Iterable[int] = range(20)) -> None:
    """Check that a primitive with its default options keeps the contract.

    Its solids are closed, face outwards and are of a hand's size; the same seed gives the same solid, and
    different seeds do not all give one.

    Raises:
        AssertionError: Naming the primitive, the seed and the fault.
    """
    from geoprior.authoring.conformance.kinds import primitive

    for check in primitive.CHECKS:
        check.run(spec, seeds)


def assert_closed(mesh: Mesh, where: str) -> None:
    """Check that every edge is met once in each direction and that the enclosed volume is positive.

    Raises:
        AssertionError: It is not so.
    """
    from geoprior.authoring.conformance.kinds.primitive import require_closed

    require_closed(mesh, where)
