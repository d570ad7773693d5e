"""ImageNet's weights for a trunk, through torchvision, which the user must have installed and asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from geoprior.errors import ConfigError, DataError, MachineError
from geoprior.policies.tensors import fill

if TYPE_CHECKING:
    from torch import Tensor, nn

    from geoprior.policies.policy import Policy

_CLASSIFIER = "fc."
_COUNTER = ".num_batches_tracked"


def load_imagenet_trunk(policy: nn.Module, name: str) -> tuple[str, ...]:
    """Put torchvision's weights of ResNet-18 (IMAGENET1K_V1) into a policy's trunk, strictly.

    torchvision downloads them unless it has them already.

    Args:
        policy: A `geoprior.policies.policy.Policy` with one trunk, whose tensors are named as torchvision's.
        name: Of the policy, for messages.

    Returns:
        Names of the tensors taken.

    Raises:
        MachineError: torchvision does not import, or cannot give the weights.
        ConfigError: The policy has no trunk, or several.
        DataError: A tensor of the trunk is missing there, extra or of another shape.
    """
    prefixes = cast("Policy", policy).trunk_prefixes
    if len(prefixes) != 1:
        raise ConfigError(
            f"policy {name!r} names {len(prefixes)} trunks; ImageNet's weights fit one", "use init: scratch"
        )
    own = {tensor for tensor in policy.state_dict() if tensor.startswith(prefixes)}
    tensors = {
        prefixes[0] + tensor: value
        for tensor, value in _published().items()
        if not tensor.startswith(_CLASSIFIER)
        and (not tensor.endswith(_COUNTER) or prefixes[0] + tensor in own)
    }
    try:
        return fill(policy, tensors, "the published ResNet-18", prefixes)
    except DataError as error:
        raise DataError(
            error.message, "the published weights fit act's trunk_width 64 with trunk_norm batch or frozen"
        ) from error


def _published() -> dict[str, Tensor]:
    try:
        from torchvision import models  # type: ignore[import-not-found]
    except (ImportError, RuntimeError, AttributeError) as error:
        raise MachineError(
            f"init imagenet: the weights come from torchvision, which does not import here ({error})",
            "install the torchvision that belongs to your torch, or use another init",
        ) from error
    try:
        network: nn.Module = models.resnet18(weights=models.ResNet18_Weights.IMAGENET1K_V1)
    except (OSError, RuntimeError) as error:
        raise MachineError(
            f"init imagenet: torchvision could not get its weights ({error})",
            "fetch them once where there is a network: they are kept in torch's hub folder",
        ) from error
    return network.state_dict()
