from dataclasses import replace

import numpy as np
import pytest

from geoprior import PrimitiveSpec
from geoprior.hooks.manager import Plugins
from geoprior.options import Options
from geoprior.scene.mesh import Mesh, convex_mesh
from geoprior.testing import assert_primitive_conforms

BUILTINS = Plugins()
BUILTINS.load_builtins()


@pytest.mark.parametrize("name", BUILTINS.names("primitive"))
def test_every_built_in_primitive_conforms(name):
    assert_primitive_conforms(BUILTINS.spec("primitive", name))


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
