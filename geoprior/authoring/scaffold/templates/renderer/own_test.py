"""What is special about this renderer."""

from __future__ import annotations

import numpy as np

from geoprior.authoring.scaffold.templates.renderer import MyPlugin, MyPluginConfig
from geoprior.episode import KINDS
from geoprior.geometry.projection import View
from geoprior.render import rig
from geoprior.render.clouds import Cloud, Shot


def test_a_point_is_one_pixel_where_the_camera_sees_it() -> None:
    lens = np.array([[10.0, 0.0, 7.0], [0.0, 10.0, 5.0], [0.0, 0.0, 1.0]])
    view = View(np.eye(4), lens, 11, 15)
    cloud = Cloud("object", np.array([[0.2, -0.1, 1.0], [0.4, -0.2, 2.0]]), np.eye(4))
    for kind in KINDS:
        renderer = MyPlugin(MyPluginConfig(frames=kind, farthest=4.0))
        frame = rig.render(renderer, Shot(view, (cloud,), 1))[0]
        assert np.argwhere(frame.reshape(11, 15, -1).any(axis=-1)).tolist() == [[4, 9]]
        assert frame.max() == (255 if kind == "binary" else 192), "the nearer one of the two"
