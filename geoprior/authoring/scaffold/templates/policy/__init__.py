"""My-plugin: a small convolutional network that predicts a chunk at once, as a policy of geoprior's."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import PolicySpec, hookimpl
from geoprior.policies.policy import PolicyOptions

if TYPE_CHECKING:
    from geoprior.policies.policy import Features, Policy


class MyPluginConfig(PolicyOptions):
    """Options of the policy, beside `chunk`."""

    width: int = Field(32, ge=4, le=1024, description="Channels of the trunk's last layer.")
    hidden: int = Field(256, ge=8, le=8192, description="Width of the layer between trunk and actions.")


def build(config: MyPluginConfig, features: Features) -> Policy:
    """Import torch and build the network; nothing heavy is imported before."""
    from geoprior.authoring.scaffold.templates.policy._network import MyPluginNetwork

    return MyPluginNetwork(config, features)


@hookimpl
def geoprior_policies() -> Iterable[PolicySpec]:
    """What this package adds."""
    yield PolicySpec(
        name="my-plugin",
        summary="three convolutions and two linear layers: pictures and pose to a chunk of actions",
        config=MyPluginConfig,
        factory=build,
    )
