"""A checkpoint of ACT as a policy of LeRobot 0.4.4: a folder that its ``ACTPolicy.from_pretrained`` loads.

The folder also holds `CHECK_FILE`, observations and the actions that geoprior says to them: so the export can
be proved where LeRobot is installed (benchmarks/check_lerobot_export.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from geoprior.errors import ConfigError, DataError
from geoprior.files import write_bytes, write_json
from geoprior.hooks.manager import plugins
from geoprior.policies.act._lerobot_files import (
    ACTION,
    METADATA,
    STATE,
    camera_key,
    config_tree,
    write_processors,
)
from geoprior.policies.act._positions import sinusoid_1d
from geoprior.policies.act.lerobot_names import COUNTER, POSITION_TABLE, to_lerobot
from geoprior.policies.checkpoint import CheckpointHeader, load_checkpoint
from geoprior.policies.normalise import Normaliser, normalise_images
from geoprior.policies.tensors import fill, save_tensors
from geoprior.policies.trunk import ResNet18

if TYPE_CHECKING:
    from geoprior.policies.act._network import ActNetwork
    from geoprior.policies.act.plugin import ActConfig

CHECK_FILE = "geoprior_check.safetensors"
_WIDTH = 64
"""Of the only trunk that LeRobot has among ours."""


def export_lerobot(
    checkpoint: Path, out: Path, execute: int | None = None, ensembling: float | None = None
) -> tuple[Path, ...]:
    """Write the folder.

    Cameras become ``observation.images.NAME``, the pose ``observation.state``. A trunk narrower than
    ResNet-18 is laid into one whose other channels are zero: the same function, at ResNet-18's price.

    Args:
        checkpoint: Path of the ``.safetensors`` file.
        out: A folder that is new or empty.
        execute: Actions of a chunk that LeRobot carries out before it looks again; None is all of them.
        ensembling: Coefficient of temporal ensembling, for which LeRobot looks at every step.

    Returns:
        The files written.

    Raises:
        DataError: The checkpoint is damaged, or LeRobot's ACT cannot be what it is; the folder is not empty.
        ConfigError: ``execute`` does not fit the chunk, or comes with ``ensembling``.
    """
    header, tensors = load_checkpoint(checkpoint)
    act = _network(checkpoint, header, tensors)
    running = _running(act.config.chunk, execute, ensembling)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DataError(f"{out}: not an empty folder", "name a new one")
    save_tensors(out / "model.safetensors", _renamed(act.config, tensors), METADATA)
    write_processors(out, header)
    save_tensors(out / CHECK_FILE, _check(act, header.normaliser), METADATA)
    write_bytes(out / "README.md", _readme(header).encode())
    write_json(out / "config.json", config_tree(act.config, header.features) | running)
    return tuple(sorted(out.iterdir()))


def _network(path: Path, header: CheckpointHeader, tensors: Mapping[str, Tensor]) -> ActNetwork:
    if header.policy.name != "act":
        raise DataError(f"{path}: a policy {header.policy.name!r}; only 'act' has a counterpart in LeRobot")
    if header.actions != "absolute":
        raise DataError(
            f"{path}: its actions are relative to the present pose; LeRobot's ACT says absolute ones",
            "train with policy.actions: absolute, or export to ONNX, whose graph adds the pose",
        )
    act: ActNetwork = plugins().build("policy", header.policy, header.features)
    if act.config.trunk_norm == "group":
        raise DataError(
            f"{path}: its trunk has group norm; LeRobot's has batch norm",
            "train with trunk_norm: batch or frozen",
        )
    if act.config.trunk_width > _WIDTH:
        raise DataError(
            f"{path}: its trunk is wider than LeRobot's ResNet-18", f"train with trunk_width: {_WIDTH}"
        )
    fill(act, tensors, path)
    return act.eval()


def _running(chunk: int, execute: int | None, ensembling: float | None) -> dict[str, float | None]:
    if ensembling is not None and execute is not None:
        raise ConfigError("execute and ensembling exclude each other", "give one of them")
    if execute is not None and not 1 <= execute <= chunk:
        raise ConfigError(f"execute {execute}: a chunk of this policy has {chunk} actions")
    steps = 1 if ensembling is not None else execute or chunk
    return {"n_action_steps": steps, "temporal_ensemble_coeff": ensembling}


def _renamed(config: ActConfig, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    wide = {**tensors, **_widened(tensors)}
    renamed = {to_lerobot(name): tensor for name, tensor in wide.items() if not name.endswith(COUNTER)}
    return renamed | {POSITION_TABLE: sinusoid_1d(2 + config.chunk, config.dim).unsqueeze(0)}


def _widened(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The trunk in the first channels of ResNet-18; what is added says zero and is not listened to."""
    templates = {f"trunk.{name}": t for name, t in ResNet18(_WIDTH, "frozen").state_dict().items()}
    projection = tensors["image_proj.weight"]
    templates["image_proj.weight"] = projection.new_zeros(len(projection), 8 * _WIDTH, 1, 1)
    wide = {}
    for name, template in templates.items():
        own = tensors[name]
        wide[name] = template.clone() if template.dim() == 1 else torch.zeros(template.shape)
        wide[name][tuple(slice(length) for length in own.shape)] = own
    return wide


def _check(act: ActNetwork, normaliser: Normaliser) -> dict[str, Tensor]:
    """Two raw observations, and the actions as the network says them, denormalised."""
    features = act.features
    rng = np.random.default_rng(0)
    pose = normaliser.denormalise("pose", rng.normal(size=(2, features.pose_size)).astype(np.float32))
    shape = (2, len(features.cameras), *features.image_size, 3)
    frames = torch.from_numpy(rng.integers(256, size=shape, dtype=np.uint8))
    poses = torch.from_numpy(normaliser.normalise("pose", pose))
    actions = act.predict({"pose": poses, "images": normalise_images(frames)}).numpy()
    cameras = {camera_key(name): frames[:, index] for index, name in enumerate(features.cameras)}
    actions = normaliser.denormalise("action", actions)
    return {**cameras, STATE: torch.from_numpy(pose), ACTION: torch.from_numpy(actions)}


def _readme(header: CheckpointHeader) -> str:
    return f"""\
# ACT, exported by geoprior for LeRobot 0.4.4

Epoch {header.epoch}, {header.fps:g} actions a second. State and action: for each hand x, y, z in metres, a
quaternion (x, y, z, w), and the gripper, 0 open and 1 closed. An action is the pose to be reached. Before an
arm gets it, make its quaternion one of unit length and close the gripper where its number is above 0.5.
Cameras: {", ".join(header.features.cameras)}; RGB in [0, 1]; binary frames repeated to three channels.

`{CHECK_FILE}` holds observations (frames uint8) and the actions that geoprior says to them.
"""
