"""What is special about this primitive."""

from __future__ import annotations

import numpy as np

from geoprior.authoring.scaffold.templates.primitive import corners
from geoprior.scene.mesh import convex_mesh


def test_the_volume_is_half_that_of_the_box_around_it() -> None:
    mesh = convex_mesh(corners(0.06, 0.04, 0.02))
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    np.testing.assert_allclose(volume, 0.5 * 0.06 * 0.04 * 0.02)
