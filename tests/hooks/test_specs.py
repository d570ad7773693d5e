import inspect
import typing

import pytest

from geoprior.hooks import specs
from geoprior.hooks.manager import SPEC_OF_HOOK

HOOKS = {name: hook for name, hook in vars(specs).items() if name.startswith("geoprior_")}


@pytest.mark.parametrize("name", sorted(HOOKS))
def test_every_hook_is_typed_and_documented(name):
    hook = HOOKS[name]
    assert inspect.getdoc(hook)
    hints = typing.get_type_hints(hook)
    assert "return" in hints
    assert set(hints) == {*inspect.signature(hook).parameters, "return"}


@pytest.mark.parametrize("name", sorted(SPEC_OF_HOOK))
def test_a_register_hook_takes_nothing_and_yields_its_own_spec(name):
    assert not inspect.signature(HOOKS[name]).parameters
    assert SPEC_OF_HOOK[name] in typing.get_args(typing.get_type_hints(HOOKS[name])["return"])


def test_every_hook_either_registers_or_tells_of_an_event():
    events = {name for name, hook in HOOKS.items() if list(inspect.signature(hook).parameters) == ["event"]}
    assert events | set(SPEC_OF_HOOK) == set(HOOKS)
