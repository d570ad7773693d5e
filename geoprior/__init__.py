"""geoprior: geometric priors for robot policies.

A plug-in needs two names from here: `hookimpl` and the spec types.

>>> from geoprior import hookimpl, PrimitiveSpec
"""

from __future__ import annotations

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

__version__ = "0.1.0.dev0"

hookimpl = pluggy.HookimplMarker("geoprior")

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
]
