"""What is special about this variant."""

from __future__ import annotations

import numpy as np

from geoprior.authoring.conformance.material import scene
from geoprior.authoring.scaffold.templates.variant import MyPlugin, MyPluginConfig
from geoprior.render.clouds import Cloud, Shot


def test_of_three_points_one_is_kept() -> None:
    points = np.arange(27.0).reshape(9, 3)
    shot = Shot(scene(0).third_view, (Cloud("object", points, np.eye(4)),), 5)
    changed = MyPlugin(MyPluginConfig(every=3)).change({"third": shot})
    np.testing.assert_array_equal(changed["third"].clouds[0].points, points[[0, 3, 6]])
