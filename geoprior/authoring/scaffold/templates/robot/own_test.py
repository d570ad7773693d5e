"""What is special about this robot."""

from __future__ import annotations

from geoprior.authoring.scaffold.templates.robot import MY_PLUGIN
from geoprior.sim.robots.robot import RobotConfig


def test_a_config_says_how_it_is_driven() -> None:
    assert MY_PLUGIN.driven(RobotConfig(controller="exact")).controller == "exact"
