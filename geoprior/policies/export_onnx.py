"""A checkpoint of any policy as one ONNX file that onnxruntime runs alone.

The graph holds normalisation, policy and the making of commands: it takes what the robot's sensors say and
gives what its controller obeys, as `geoprior.policies.policy.Predictor.predict` does.
"""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import nn

from geoprior import __version__
from geoprior.episode import POSE_FIELDS, POSE_SIZE
from geoprior.errors import DataError, MachineError, NumericalError, PluginError
from geoprior.files import write_bytes
from geoprior.hooks.manager import plugins
from geoprior.policies.checkpoint import CheckpointHeader, load_checkpoint
from geoprior.policies.deployed import DeployedPolicy
from geoprior.policies.normalise import Normaliser
from geoprior.policies.predictor import LoadedPredictor
from geoprior.policies.tensors import fill

if TYPE_CHECKING:
    from pathlib import Path

    import onnx
    from numpy.typing import NDArray

    from geoprior.policies.policy import Features

POSE, ACTION = "pose", "action"
METADATA_KEY = "geoprior"
"""Of the ONNX file's properties: a JSON object, see `describe`."""
FORMAT = "geoprior-onnx"
FORMAT_VERSION = 2
TOLERANCE = 1e-5
"""By which an action may differ from the predictor's, in units of the raw action."""
_OPSET = 18
_LARGEST = 2**31 - 2**24
"""Bytes of weights: a protobuf message ends at 2 GiB, and the graph needs room."""


@dataclass(frozen=True)
class OnnxExport:
    """What was written.

    Attributes:
        path: The file.
        deviation: The largest difference from the predictor's actions that onnxruntime showed, in units of
            the raw action; None where onnxruntime is not installed and nothing was compared.
    """

    path: Path
    deviation: float | None


def export_onnx(checkpoint: Path, out: Path) -> OnnxExport:
    """Write the file; where onnxruntime is installed, only if it says the checkpoint's actions.

    Inputs are ``pose`` (batch, pose_size) float32, and for each camera, under its own name, (batch, height,
    width, 3) uint8 RGB; a binary frame is given with its values repeated to three channels. The output
    ``action`` is (batch, chunk, pose_size) float32: quaternions of unit length, grippers 0 or 1, and NaN
    in all numbers of an action that is not finite. Poses are normalised in float64.

    Args:
        checkpoint: Path of the ``.safetensors`` file.
        out: The file; one that is there is replaced.

    Raises:
        MachineError: A package that writes ONNX is not installed.
        DataError: The checkpoint is damaged, a camera's name is taken, the weights do not fit into one file,
            or it cannot be written.
        PluginError: torch cannot turn the policy into a graph.
        NumericalError: The graph's actions are not the checkpoint's; nothing is written.
    """
    _require_packages()
    header, tensors = load_checkpoint(checkpoint)
    _require_free_names(checkpoint, header.features)
    policy: nn.Module = plugins().build("policy", header.policy, header.features)
    fill(policy, tensors, checkpoint)
    normaliser = header.normaliser
    deployed = DeployedPolicy(policy, normaliser)
    _require_room(checkpoint, deployed)
    model = _as_graph(deployed, header)
    model.producer_name, model.producer_version = "geoprior", __version__
    model.metadata_props.add(key=METADATA_KEY, value=json.dumps(describe(header), sort_keys=True))
    content: bytes = model.SerializeToString(deterministic=True)
    deviation = None
    if find_spec("onnxruntime") is not None:
        predictor = LoadedPredictor(policy, header.features, header.fps, normaliser)
        deviation = _deviation(content, predictor, deployed, normaliser)
        _require_the_same_actions(checkpoint, deviation)
    write_bytes(out, content)
    return OnnxExport(out, deviation)


def describe(header: CheckpointHeader) -> dict[str, Any]:
    """What the file says of itself: everything that a robot's program needs besides the graph."""
    features = header.features
    height, width = features.image_size
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "geoprior": __version__,
        "policy": header.policy.name,
        "epoch": header.epoch,
        "step": header.step,
        "fps": header.fps,
        "chunk": features.chunk,
        "hands": list(features.hands),
        "pose_fields": list(POSE_FIELDS),
        "units": {"position": "m", "quaternion": "x, y, z, w of unit length", "gripper": "0 open, 1 closed"},
        "cameras": list(features.cameras),
        "frames": {"height": height, "width": width, "channels": 3, "order": "RGB", "type": "uint8"},
        "action": "poses to be reached, fps of them a second, the first at 1 / fps after the observation",
    }


def _require_packages() -> None:
    missing = [name for name in ("onnx", "onnxscript") if find_spec(name) is None]
    if missing:
        raise MachineError(
            f"to write ONNX, the package {missing[0]} is missing", "pip install 'geoprior[onnx]'"
        )


def _require_free_names(path: Path, features: Features) -> None:
    taken = sorted({POSE, ACTION} & set(features.cameras))
    if taken:
        raise DataError(
            f"{path}: a camera is named {taken[0]!r}, and so is another tensor of the graph",
            "rename the camera in the data and train again",
        )


def _require_room(path: Path, module: nn.Module) -> None:
    size = sum(tensor.nbytes for tensor in module.state_dict().values())
    if size > _LARGEST:
        raise DataError(f"{path}: its weights take {size / 2**30:.1f} GiB; one ONNX file holds less than 2")


def _as_graph(deployed: DeployedPolicy, header: CheckpointHeader) -> onnx.ModelProto:
    import onnx
    import onnx_ir
    from onnx_ir.passes.common import ClearMetadataAndDocStringPass, NameFixPass

    cameras = header.features.cameras
    try:
        with _exporter_kept_quiet():
            program = torch.onnx.export(
                _captured(deployed, header.features),
                input_names=[POSE, *cameras],
                output_names=[ACTION],
                dynamic_shapes=({0: "batch"}, tuple({0: "batch"} for _ in cameras)),  # names the axis
                opset_version=_OPSET,
                dynamo=True,
                verbose=False,
            )
    except Exception as error:
        first = str(error).strip().partition("\n")[0]
        raise PluginError(
            f"policy {header.policy.name!r}: torch cannot turn its `predict` into a graph: {first}",
            "write it in tensor operations, with shapes that nothing but the batch decides; see --verbose",
        ) from error
    assert program is not None
    # A camera's name may be that of a tensor inside, and torch notes its source files at every node.
    model = ClearMetadataAndDocStringPass()(NameFixPass()(program.model).model).model
    proto: onnx.ModelProto = onnx_ir.to_proto(model)
    onnx.checker.check_model(proto, full_check=True)
    return proto


def _captured(deployed: DeployedPolicy, features: Features) -> torch.export.ExportedProgram:
    """By reading the bytecode, which follows ``len(tensor)``; what that cannot read is run instead."""
    batch = torch.export.Dim("batch", min=1)
    frames = torch.zeros(2, *features.image_size, 3, dtype=torch.uint8)
    example = (torch.zeros(2, features.pose_size), *(frames.clone() for _ in features.cameras))
    shapes = ({0: batch}, tuple({0: batch} for _ in features.cameras))
    try:
        return torch.export.export(deployed, example, dynamic_shapes=shapes, strict=True)
    except Exception:  # noqa: BLE001 - dynamo may raise anything over code that it does not know
        return torch.export.export(deployed, example, dynamic_shapes=shapes, strict=False)


@contextmanager
def _exporter_kept_quiet() -> Iterator[None]:
    """Its warnings and log lines are about its own inside, and nothing that a user could mend."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _require_the_same_actions(path: Path, deviation: float) -> None:
    if not deviation <= TOLERANCE:  # NaN is refused too
        raise NumericalError(
            f"{path}: under onnxruntime its actions differ by {deviation:.1e}, more than {TOLERANCE:g}",
            "nothing was written; the policy must predict without randomness, alike for every batch",
        )


def _deviation(
    content: bytes, predictor: LoadedPredictor, deployed: DeployedPolicy, normaliser: Normaliser
) -> float:
    """The largest difference between graph and predictor on a batch of one and one of three."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    features, rng = predictor.features, np.random.default_rng(0)
    found = []
    for rows in (1, 3):
        pose = rng.normal(size=(rows, features.pose_size)).astype(np.float32)
        pose = normaliser.denormalise("pose", pose)
        shape = (rows, *features.image_size, 3)
        frames = {name: rng.integers(256, size=shape, dtype=np.uint8) for name in features.cameras}
        (actions,) = session.run([ACTION], {POSE: pose, **frames})
        with torch.inference_mode():
            raw = deployed.act(*(torch.from_numpy(array) for array in (pose, *frames.values()))).numpy()
        found.append(largest_difference(actions, predictor.predict(pose, frames), raw))
    return float(np.max(found))


def largest_difference(
    ours: NDArray[np.float32], theirs: NDArray[np.float32], raw: NDArray[np.float32]
) -> float:
    """How far two arrays of commands are apart, in units of the raw action.

    A raw error of d turns a quaternion of length n by d / n, and closes a gripper whose number is within
    d of the threshold: the one is scaled back, and the other is let pass where d is `TOLERANCE`.

    Args:
        ours: (..., 8 x hands) commands.
        theirs: The same.
        raw: The actions before they were made commands.

    Returns:
        The largest absolute difference; NaN where one is.
    """
    difference = np.abs(ours - theirs).reshape(-1, POSE_SIZE)
    by_hand = raw.reshape(-1, POSE_SIZE)
    lengths = np.linalg.norm(by_hand[:, 3:7], axis=-1, keepdims=True)
    difference[:, 3:7] *= np.minimum(lengths, 1.0)
    difference[np.abs(by_hand[:, 7] - 0.5) <= TOLERANCE, 7] = 0.0
    return float(difference.max())
