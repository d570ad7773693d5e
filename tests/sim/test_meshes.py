from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from geoprior.sim.meshes import cluster_triangles, lighten_meshes


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.01, 0.5))
def test_clustered_triangles_stay_near_and_whole(seed, cell):
    rng = np.random.default_rng(seed)
    vertices = rng.random((60, 3)).astype(np.float32)
    triangles = rng.integers(0, 60, (120, 3)).astype(np.int32)
    merged, source = cluster_triangles(vertices, triangles, cell)
    assert len(merged) == len(source) <= len(triangles)
    assert all(len(set(row)) == 3 for row in merged.tolist())
    assert len({tuple(sorted(row)) for row in merged.tolist()}) == len(merged)
    moved = np.abs(vertices[merged] - vertices[triangles[source]]).max(initial=0.0)
    assert moved <= cell * (1 + 1e-5)


def test_fine_grid_changes_nothing():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=np.float32)
    triangles = np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32)
    merged, source = cluster_triangles(vertices, triangles, 0.1)
    np.testing.assert_array_equal(merged, triangles)
    np.testing.assert_array_equal(source, [0, 1])


def test_light_meshes_have_a_fraction_of_the_triangles(env):
    faces = env.world.sim.model.mesh_facenum
    assert 0 < faces.sum() < 0.25 * len(env.world.sim.model.mesh_face)
    assert faces.min() > 0


def test_larger_frames_keep_finer_meshes(env):
    """And none is finer than it needs to be: a frame of 128 rows or fewer has the coarsest."""
    counts = []
    for rows in (64, 128, 256, 480):
        stock = env.task.make(env.robot, env.setting)
        counts.append(lighten_meshes(stock.sim.model._model, rows)[1])
    assert counts[0] == counts[1] < counts[2] < counts[3]
    assert counts[1] < 0.35 * counts[3]
