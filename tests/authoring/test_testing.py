import types
from dataclasses import replace

import numpy as np
import pytest

from geoprior import PrimitiveSpec, hookimpl
from geoprior.authoring.conformance.suite import checks_of
from geoprior.authoring.testing import assert_conforms, assert_primitive_conforms, cases, cases_of
from geoprior.errors import MachineError, PluginError
from geoprior.hooks.manager import Plugins
from geoprior.options import Options
from geoprior.scene.mesh import Mesh, convex_mesh


def builtins():
    found = Plugins()
    found.load_builtins()
    return found


def a_module(*specs):
    """A plug-in module that nobody has installed."""

    def geoprior_primitives():
        yield from specs

    module = types.ModuleType("geoprior_mug")
    module.geoprior_primitives = hookimpl(geoprior_primitives)
    return module


def sphere(name="mug", **changes):
    return replace(builtins().spec("primitive", "sphere"), name=name, **changes)


def test_there_is_a_case_for_each_sentence_of_each_spec():
    found = cases(a_module(sphere("mug"), sphere("cup")))
    assert {case.values[0].spec.name for case in found} == {"cup", "mug"}
    assert len(found) == 2 * len(checks_of(sphere()))
    assert "primitive mug: its solids are closed and face outwards" in {case.id for case in found}


def test_what_takes_long_is_marked_slow():
    specs = [entry.spec for entry in builtins().registered()]
    marked = {case.values[0].sentence.sentence for case in cases_of(specs) if case.marks}
    assert "it demonstrates a task" in marked
    assert "its solids are closed and face outwards" not in marked


def test_a_module_whose_name_is_taken_has_no_cases():
    with pytest.raises(PluginError, match="'sphere' is registered twice"):
        cases(a_module(sphere("sphere")))


def test_a_case_that_fails_says_what_to_do_and_shows_no_frames():
    (case,) = (each for each in cases(a_module(sphere(summary=""))) if "summary" in each.id)
    with pytest.raises(pytest.fail.Exception, match=r"summary is empty\n  say in one line") as caught:
        case.values[0].check()
    assert not caught.value.pytrace


def test_the_machine_may_be_unfit_for_a_case():
    def factory(config):
        raise MachineError("OpenGL: no library")

    (case,) = (each for each in cases(a_module(sphere(factory=factory))) if "closed" in each.id)
    with pytest.raises(pytest.skip.Exception, match="OpenGL"):
        case.values[0].check()


def test_a_spec_can_be_held_to_its_contract_in_one_call():
    assert_conforms(sphere())
    with pytest.raises(AssertionError, match="its summary is empty"):
        assert_conforms(sphere(summary=""))


def test_the_fixture_has_the_built_ins_and_nobody_elses_plug_ins(fresh_plugins):
    assert {plugin.package for plugin in fresh_plugins.found} == {"geoprior"}


class Faulty:
    def __init__(self, fault):
        self.fault = fault

    def sample(self, rng):
        corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1]), -1).reshape(-1, 3) * rng.uniform(0.02, 0.1)
        return self.fault(convex_mesh(corners.astype(float)))


@pytest.mark.parametrize(
    ("fault", "complaint"),
    [
        (lambda mesh: replace(mesh, faces=mesh.faces[1:]), "surface is open"),
        (lambda mesh: replace(mesh, faces=mesh.faces[:, ::-1]), "look inwards"),
        (lambda mesh: replace(mesh, vertices=mesh.vertices * 100), "measures"),
        (lambda mesh: replace(mesh, vertices=mesh.vertices / np.ptp(mesh.vertices) * 0.1), "same solid"),
        (lambda mesh: Mesh(mesh.vertices + np.random.default_rng().uniform(), mesh.faces), "elsewhere"),
    ],
)
def test_a_primitive_that_breaks_the_contract_is_caught(fault, complaint):
    spec = PrimitiveSpec("faulty", "for a test", Options, lambda config: Faulty(fault))
    with pytest.raises(AssertionError, match=complaint):
        assert_primitive_conforms(spec)
