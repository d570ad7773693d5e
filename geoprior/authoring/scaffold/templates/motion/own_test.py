"""What is special about this motion."""

from __future__ import annotations

import numpy as np

from geoprior.authoring.conformance.material import scene
from geoprior.authoring.scaffold.templates.motion import MyPlugin, MyPluginConfig


def test_the_hand_ends_above_the_object_and_points_down() -> None:
    for number in range(7):
        before = scene(number)
        plan = MyPlugin(MyPluginConfig()).plan(before, 30, np.random.default_rng(number))
        last = plan.hand.transforms_hand_to_world[-1]
        np.testing.assert_allclose(last[:3, 2], [0.0, 0.0, -1.0], atol=1e-9)
        np.testing.assert_allclose(last[:2, 3], before.object.centre[:2], atol=1e-9)
        assert last[2, 3] > before.object.vertices[:, 2].max()
