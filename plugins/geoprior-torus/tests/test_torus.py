import numpy as np
import pytest
from geoprior_torus import geoprior_primitives, torus_mesh

from geoprior.authoring.testing import assert_closed, assert_primitive_conforms


def test_it_keeps_the_contract_of_a_primitive():
    (spec,) = geoprior_primitives()
    assert_primitive_conforms(spec)


def test_the_volume_is_that_of_a_torus():
    mesh = torus_mesh(0.05, 0.02)
    assert_closed(mesh, "a torus")
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(2.0 * np.pi**2 * 0.05 * 0.02**2, rel=0.02)
