"""The files in which LeRobot 0.4.4 keeps what is not a weight: sizes, features, and the normalisation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from geoprior.files import write_json
from geoprior.policies.act.lerobot_names import OPTIONS
from geoprior.policies.normalise import IMAGE_MEAN, IMAGE_STD, STD_FLOOR
from geoprior.policies.tensors import save_tensors

if TYPE_CHECKING:
    from geoprior.policies.act.plugin import ActConfig
    from geoprior.policies.checkpoint import CheckpointHeader
    from geoprior.policies.policy import Features

STATE, ACTION = "observation.state", "action"
METADATA = {"format": "pt"}
"""Of every safetensors file."""
_NORM_MAP = {"VISUAL": "MEAN_STD", "STATE": "MEAN_STD", "ACTION": "MEAN_STD"}
_ON_CPU = {"registry_name": "device_processor", "config": {"device": "cpu", "float_dtype": None}}


def camera_key(name: str) -> str:
    """LeRobot's name of a camera's frames."""
    return f"observation.images.{name}"


def _inputs(features: Features) -> dict[str, Any]:
    images = {
        camera_key(name): {"type": "VISUAL", "shape": [3, *features.image_size]} for name in features.cameras
    }
    return {**images, STATE: {"type": "STATE", "shape": [features.pose_size]}}


def _outputs(features: Features) -> dict[str, Any]:
    return {ACTION: {"type": "ACTION", "shape": [features.pose_size]}}


def config_tree(config: ActConfig, features: Features) -> dict[str, Any]:
    """What ``config.json`` says of the network; not how it is run."""
    options = {theirs: getattr(config, ours) for ours, theirs in OPTIONS.items()}
    fixed = {
        "type": "act",
        "device": "cpu",
        "push_to_hub": False,
        "n_obs_steps": 1,
        "vision_backbone": "resnet18",
        "pretrained_backbone_weights": None,
        "replace_final_stride_with_dilation": False,
        "pre_norm": False,
        "feedforward_activation": "relu",
        "use_vae": True,
        "normalization_mapping": _NORM_MAP,
    }
    return {**options, **fixed, "input_features": _inputs(features), "output_features": _outputs(features)}


def write_processors(out: Path, header: CheckpointHeader) -> None:
    """The pipelines before and after the network: four files."""
    statistics = _statistics(header)
    inputs, outputs = _inputs(header.features), _outputs(header.features)
    before = [
        {"registry_name": "rename_observations_processor", "config": {"rename_map": {}}},
        {"registry_name": "to_batch_processor", "config": {}},
        _ON_CPU,
        _step("normalizer_processor", {**inputs, **outputs}, "policy_preprocessor_step_3"),
    ]
    after = [_step("unnormalizer_processor", outputs, "policy_postprocessor_step_0"), _ON_CPU]
    for name, steps in (("policy_preprocessor", before), ("policy_postprocessor", after)):
        for state in (step["state_file"] for step in steps if "state_file" in step):
            save_tensors(out / state, statistics, METADATA)
        write_json(out / f"{name}.json", {"name": name, "steps": steps})


def _step(name: str, features: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    config = {"eps": 1e-8, "features": features, "norm_map": _NORM_MAP}
    return {"registry_name": name, "config": config, "state_file": f"{prefix}_{name}.safetensors"}


def _statistics(header: CheckpointHeader) -> dict[str, Tensor]:
    """As LeRobot's normaliser keeps them; the floor of the deviations is in the numbers."""
    tensors = {}
    for ours, theirs in (("pose", STATE), ("action", ACTION)):
        feature = header.statistics[ours]
        tensors[f"{theirs}.mean"] = torch.tensor(feature.mean)
        tensors[f"{theirs}.std"] = torch.tensor(feature.std).clamp_min(STD_FLOOR)
    for name in header.features.cameras:
        tensors[f"{camera_key(name)}.mean"] = torch.tensor(IMAGE_MEAN)[:, None, None]
        tensors[f"{camera_key(name)}.std"] = torch.tensor(IMAGE_STD)[:, None, None]
    return tensors
