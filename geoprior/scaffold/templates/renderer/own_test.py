"""What is special about this renderer."""

from __future__ import annotations

import numpy as np

from geoprior.geometry.projection import View
from geoprior.render.clouds import Cloud
from geoprior.render.packing import unpack_frames
from geoprior.scaffold.templates.renderer import MyPlugin, MyPluginConfig


def test_a_point_is_one_pixel_where_the_camera_sees_it() -> None:
    lens = np.array([[10.0, 0.0, 7.0], [0.0, 10.0, 5.0], [0.0, 0.0, 1.0]])
    view = View(np.eye(4), lens, 11, 15)
    cloud = Cloud("object", np.array([[0.2, -0.1, 1.0]]), np.eye(4))
    frames = unpack_frames(MyPlugin(MyPluginConfig()).render([cloud], view, 1), 15)
    assert np.argwhere(frames[0]).tolist() == [[4, 9]]
