from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoprior.options import Choice
from geoprior.sim.culling import Boxes
from geoprior.sim.views import VISUAL_GROUP, Views
from geoprior.sim.workers import Setup, environment


def _frames_of_all(views: Views, model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, np.ndarray]:
    """The frames of one scene that holds every geometry."""
    scene, rectangle = views._scene, views._rectangle
    mujoco.mjv_updateScene(
        model, data, views._option, None, views._cameras[0], mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    frames = {}
    for name, camera in zip(views._names, views._cameras, strict=True):
        mujoco.mjv_updateCamera(model, data, camera, scene)
        mujoco.mjr_render(rectangle, scene, views._renderer)
        frames[name] = np.empty((rectangle.height, rectangle.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(frames[name], None, rectangle, views._renderer)
    return {name: frame[::-1] for name, frame in frames.items()}


def _count_drawn(monkeypatch) -> list[int]:
    """How many geometries each scene to come holds."""
    counts, update = [], mujoco.mjv_updateScene

    def counting(*arguments):
        update(*arguments)
        counts.append(arguments[-1].ngeom)

    monkeypatch.setattr(mujoco, "mjv_updateScene", counting)
    return counts


@pytest.mark.parametrize("arm", ["ur5e", "xarm7", pytest.param("kinova3", marks=pytest.mark.slow)])
def test_pictures_of_an_episode_are_the_same_to_the_pixel(arm, pick, cameras, monkeypatch):
    env = environment(Setup(Choice(name=arm), pick, cameras), 10)
    env.reset(3)
    counts = _count_drawn(monkeypatch)
    before = env.world.sim.model.geom_group.copy()
    for step, command in enumerate(env.expert(seed=0)):
        env.step(command)
        if step % 3:
            continue
        frames = env.render()
        whole = _frames_of_all(env.eyes._views[64, 64], env._model, env._data)
        for name in whole:
            np.testing.assert_array_equal(frames[name], whole[name])
        hand, third, everything = counts
        assert hand < 0.7 * everything
        assert third < everything
        counts.clear()
    np.testing.assert_array_equal(env.world.sim.model.geom_group, before)


SHAPES = """
<mujoco>
  <asset><mesh name="wedge" vertex="0 0 0  .4 0 0  0 .3 0  0 0 .2"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="3 3 .1" group="1" rgba=".3 .3 .4 1"/>
    {}
    <camera name="one" fovy="50"/>
    <camera name="two" fovy="80"/>
  </worldbody>
</mujoco>
"""
KINDS = (
    'type="box" size=".2 .1 .05"',
    'type="sphere" size=".1"',
    'type="capsule" size=".05 .2"',
    'type="cylinder" size=".1 .15"',
    'type="ellipsoid" size=".2 .1 .05"',
    'type="mesh" mesh="wedge"',
)


def _shapes(rng: np.random.Generator) -> mujoco.MjModel:
    geoms = []
    for number in range(40):
        place = " ".join(map(str, rng.uniform(-1.5, 1.5, 3)))
        turn = " ".join(map(str, rng.normal(size=4)))
        colour = " ".join(map(str, rng.uniform(0.2, 1.0, 3)))
        kind = KINDS[number % len(KINDS)]
        geoms.append(f'<geom {kind} pos="{place}" quat="{turn}" rgba="{colour} 1" group="1"/>')
    return mujoco.MjModel.from_xml_string(SHAPES.format("\n".join(geoms)))


@pytest.mark.parametrize(("height", "width"), [(48, 48), (40, 72), (72, 40)])
def test_pictures_among_shapes_are_the_same_from_anywhere(height, width, monkeypatch):
    rng = np.random.default_rng(height)
    model = _shapes(rng)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    views = Views(model, ["one", "two"], height, width)
    counts = _count_drawn(monkeypatch)
    for _ in range(40):
        for camera in range(2):
            data.cam_xpos[camera] = rng.uniform(-2.0, 2.0, 3)
            data.cam_xmat[camera] = Rotation.random(random_state=rng.integers(2**31)).as_matrix().ravel()
        frames, whole = views.draw(model, data), _frames_of_all(views, model, data)
        for name in whole:
            np.testing.assert_array_equal(frames[name], whole[name])
    views.close()
    counts = np.reshape(counts, (-1, 3))
    assert counts[:, :2].mean() < 0.5 * counts[:, 2].mean()


def test_groups_are_put_back_when_drawing_fails(env):
    env.reset(1)
    boxes, model = Boxes(env._model, VISUAL_GROUP), env._model
    before = model.geom_group.copy()
    outside = np.ones(np.count_nonzero(before == VISUAL_GROUP), dtype=bool)

    def fail() -> None:
        with boxes.hidden(outside):
            assert not (model.geom_group == VISUAL_GROUP).any()
            raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        fail()
    np.testing.assert_array_equal(model.geom_group, before)
