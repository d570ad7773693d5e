"""geoprior: geometric priors for robot policies.

A plug-in needs two names from here: `hookimpl` and the spec types.

>>> from geoprior import hookimpl, PrimitiveSpec

Whoever deploys a policy needs `load_policy`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pluggy

from geoprior.hooks.types import (
    ExecutorSpec,
    LookSpec,
    MotionSpec,
    PolicySpec,
    PrimitiveSpec,
    RendererSpec,
    RobotSpec,
    SourceSpec,
    StageEvent,
    TaskSpec,
    TrainStep,
    VariantSpec,
)

if TYPE_CHECKING:
    from geoprior.policies.policy import Predictor

__version__ = "0.1.0.dev0"

hookimpl = pluggy.HookimplMarker("geoprior")


def load_policy(checkpoint: str | Path) -> Predictor:
    """Load a checkpoint: raw observations in, chunks of pose commands out.

    Args:
        checkpoint: The ``.safetensors`` file; its ``.json`` lies beside it.

    Returns:
        A `geoprior.policies.policy.Predictor`: ``predict(pose, images)``, ``features`` (cameras, hands, size
        of the images, chunk) and ``fps``.

    Raises:
        DataError: The pair is missing, damaged or foreign, or does not fit its own description.
        ConfigError: The policy is of a plug-in that is not installed.
    """
    from geoprior.policies.checkpoint import load_predictor

    return load_predictor(Path(checkpoint))


__all__ = [
    "ExecutorSpec",
    "LookSpec",
    "MotionSpec",
    "PolicySpec",
    "PrimitiveSpec",
    "RendererSpec",
    "RobotSpec",
    "SourceSpec",
    "StageEvent",
    "TaskSpec",
    "TrainStep",
    "VariantSpec",
    "__version__",
    "hookimpl",
    "load_policy",
]
