"""The contract of each kind, held against every built-in and against what a new package begins as."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import pytest

from geoprior.authoring.conformance import common
from geoprior.authoring.conformance.suite import checks_of
from geoprior.authoring.testing import cases, cases_of
from geoprior.hooks.manager import HOOK_OF_KIND, Plugins

BUILTINS = Plugins()
BUILTINS.load_builtins()
SPECS = [entry.spec for entry in BUILTINS.registered()]
TEMPLATES = {kind: import_module(f"geoprior.authoring.scaffold.templates.{kind}") for kind in HOOK_OF_KIND}
SECONDS_EACH = {("policy", "act"), ("source", "endless"), ("executor", "local"), ("executor", "my-plugin")}
"""What starts processes or builds large networks: all of its cases are slow ones."""


def marked(given):
    """The cases, those of `SECONDS_EACH` as slow ones."""
    for case in given:
        spec = case.values[0].spec
        heavy = (spec.kind, spec.name) in SECONDS_EACH
        yield pytest.param(*case.values, id=case.id, marks=[*case.marks, *[pytest.mark.slow] * heavy])


@pytest.mark.parametrize("case", list(marked(cases_of(SPECS))))
def test_every_built_in_keeps_its_contract(case):
    case.check()


@pytest.mark.parametrize("case", [case for module in TEMPLATES.values() for case in marked(cases(module))])
def test_what_a_new_package_begins_as_keeps_its_contract(case):
    case.check()


@pytest.mark.parametrize("kind", HOOK_OF_KIND)
def test_every_kind_has_a_contract_of_its_own(kind):
    spec = cases(TEMPLATES[kind])[0].values[0].spec
    sentences = [check.sentence for check in checks_of(spec)]
    assert spec.kind == kind
    assert len(sentences) == len(set(sentences)) > len(common.CHECKS)


@pytest.mark.parametrize(
    "kind", [kind for kind in HOOK_OF_KIND if find_spec(f"{TEMPLATES[kind].__name__}.own_test")]
)
def test_what_is_special_about_a_new_package_is_so(kind):
    module = import_module(f"{TEMPLATES[kind].__name__}.own_test")
    tests = [value for name, value in vars(module).items() if name.startswith("test_")]
    assert tests
    for test in tests:
        test()


@pytest.mark.parametrize("kind", HOOK_OF_KIND)
def test_what_a_new_package_begins_as_is_in_no_config_yet(kind):
    assert "my-plugin" not in BUILTINS.names(kind)
