"""What LeRobot's ACT computes, written down for tests/policies/test_lerobot_parity.py.

    python benchmarks/lerobot_parity.py --out tests/policies/golden/lerobot_act.safetensors

It runs in an environment of LeRobot's own (0.4.4, which wants numpy 2) and does not import geoprior. Weights
and inputs come from the formulas in parity_values.py, so the file holds outputs alone; its metadata holds the
options of each case and the versions.
"""

from __future__ import annotations

import argparse
import json
from importlib.metadata import version
from pathlib import Path
from unittest import mock

import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy, ACTTemporalEnsembler
from parity_values import parameter_values, uniform
from safetensors.torch import save_file
from torch import Tensor

SMALL = {
    "dim_model": 32,
    "n_heads": 4,
    "dim_feedforward": 48,
    "n_encoder_layers": 2,
    "n_vae_encoder_layers": 2,
}
CASES = {
    # Padded steps in three rows: none, some, all but one.
    "two_cameras": {
        "config": {**SMALL, "latent_dim": 8, "chunk_size": 6},
        "cameras": ["hand", "third"],
        "image_size": [64, 96],
        "pose_size": 8,
        "steps": [6, 2, 1],
    },
    # More than one decoder layer, two hands, and frames that are no multiple of the trunk's stride.
    "deep": {
        "config": {**SMALL, "n_decoder_layers": 3, "latent_dim": 5, "chunk_size": 9, "kl_weight": 3.0},
        "cameras": ["front"],
        "image_size": [70, 45],
        "pose_size": 16,
        "steps": [4, 9],
    },
    # LeRobot's own sizes.
    "published": {
        "config": {},
        "cameras": ["hand", "third"],
        "image_size": [96, 96],
        "pose_size": 8,
        "steps": [100, 30],
    },
}

ENSEMBLE = {"coefficient": 0.1, "steps": 15, "chunk": 6}


def build(case: dict, dropout: float = 0.0) -> ACTPolicy:
    """A policy without pretrained weights, in training mode."""
    images = {
        f"observation.images.{camera}": PolicyFeature(FeatureType.VISUAL, (3, *case["image_size"]))
        for camera in case["cameras"]
    }
    state = {"observation.state": PolicyFeature(FeatureType.STATE, (case["pose_size"],))}
    action = {"action": PolicyFeature(FeatureType.ACTION, (case["pose_size"],))}
    options = {"n_action_steps": 1, "pretrained_backbone_weights": None, "device": "cpu", **case["config"]}
    config = ACTConfig(input_features={**state, **images}, output_features=action, dropout=dropout, **options)
    return ACTPolicy(config).train()


def fill(policy: ACTPolicy) -> None:
    """Give every tensor its values by formula, but the position table, which is computed."""
    for name, tensor in policy.state_dict().items():
        if name != "model.vae_encoder_pos_enc":
            tensor.copy_(torch.from_numpy(parameter_values(name, tuple(tensor.shape))))


def make_batch(case: dict, chunk: int) -> dict[str, Tensor]:
    """The training batch of a case; every row has some steps and then padding."""
    rows, pose_size = len(case["steps"]), case["pose_size"]
    shapes = {f"observation.images.{camera}": (rows, 3, *case["image_size"]) for camera in case["cameras"]}
    shapes |= {"observation.state": (rows, pose_size), "action": (rows, chunk, pose_size)}
    batch = {name: torch.from_numpy(uniform(name, shape)) for name, shape in shapes.items()}
    batch["action_is_pad"] = torch.arange(chunk) >= torch.tensor(case["steps"])[:, None]
    return batch


def scaled_by_place(x: Tensor, p: float, *_: bool) -> Tensor:
    """Stands in for dropout while training: a pattern along the last axis instead of chance."""
    return x * (1.0 + p * torch.cos(torch.arange(x.shape[-1], dtype=x.dtype)))


def learn(policy: ACTPolicy, batch: dict[str, Tensor], style: Tensor) -> dict[str, Tensor]:
    """One pass in training mode with a given draw of the style: outputs and losses."""
    with mock.patch("torch.randn_like", return_value=style):
        loss, parts = policy(batch)
        actions, (mean, log_variance) = policy.model(with_images(policy, batch))
    losses = torch.tensor([loss.item(), parts["l1_loss"], parts["kld_loss"]])
    return {"actions": actions, "mu": mean, "log_sigma_x2": log_variance, "losses": losses}


def with_images(policy: ACTPolicy, batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """The batch as the bare network wants it."""
    return {**batch, "observation.images": [batch[key] for key in policy.config.image_features]}


def gradients(policy: ACTPolicy, batch: dict[str, Tensor], style: Tensor) -> Tensor:
    """(parameters, 2), by name: the norm of each gradient, and its component along a formula's direction.

    In float64: in float32, a ReLU that flips at zero can move the trunk's by half a percent.
    """
    policy.double()
    batch = {name: x.double() if x.is_floating_point() else x for name, x in batch.items()}
    with mock.patch("torch.randn_like", return_value=style.double()):
        policy(batch)[0].backward()
    rows = []
    for name, parameter in sorted(policy.named_parameters()):
        direction = torch.from_numpy(uniform(f"{name} direction", tuple(parameter.shape)))
        rows.append([parameter.grad.norm(), (parameter.grad * direction).sum() / direction.norm()])
    return torch.tensor(rows)


def initial_spread(case: dict) -> Tensor:
    """(tensors, 2), by name: standard deviation and greatest magnitude of the initial values."""
    torch.manual_seed(0)
    tensors = build(case).state_dict()
    rows = [
        [tensor.std(correction=0), tensor.abs().max()]
        for name, tensor in sorted(tensors.items())
        if name != "model.vae_encoder_pos_enc"
    ]
    return torch.tensor(rows)


def compute(case: dict) -> dict[str, Tensor]:
    """All that a case's tests compare with."""
    policy = build(case)
    fill(policy)
    batch = make_batch(case, policy.config.chunk_size)
    style = torch.from_numpy(uniform("style", (len(case["steps"]), policy.config.latent_dim)))
    outputs = learn(policy, batch, style)
    outputs["vae_position"] = policy.state_dict()["model.vae_encoder_pos_enc"][0, :8]
    outputs["predicted"] = policy.predict_action_chunk(batch)
    outputs["initial_spread"] = initial_spread(case)
    outputs["gradients"] = gradients(policy.train(), batch, style)

    dropping = build(case, dropout=0.5)
    fill(dropping)
    with mock.patch("torch.nn.functional.dropout", scaled_by_place):
        dropped = learn(dropping, batch, style)
    return outputs | {f"dropped_{name}": tensor for name, tensor in dropped.items()}


def ensembled() -> Tensor:
    """(steps, 8): LeRobot's temporal ensembling of a chunk a step; quaternions near (0, 0, 0, 1)."""
    ensembler = ACTTemporalEnsembler(ENSEMBLE["coefficient"], ENSEMBLE["chunk"])
    near = torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.5])
    shape = (ENSEMBLE["chunk"], len(near))
    chunks = [near + torch.from_numpy(uniform(f"chunk {step}", shape)) for step in range(ENSEMBLE["steps"])]
    return torch.cat([ensembler.update(chunk.unsqueeze(0)) for chunk in chunks])


def main() -> None:
    """Compute every case and write one file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    torch.set_num_threads(1)
    tensors = {"ensembled": ensembled()}
    for name, case in CASES.items():
        outputs = compute(case)
        tensors |= {f"{name}/{key}": tensor.detach().contiguous() for key, tensor in outputs.items()}
        print(name, "loss, l1, kl:", *outputs["losses"].tolist())
    versions = {package: version(package) for package in ("lerobot", "torch", "torchvision")}
    # One key: safetensors writes several in an order that changes from run to run.
    given = {"versions": versions, "cases": CASES, "ensemble": ENSEMBLE}
    save_file(tensors, options.out, {"parity": json.dumps(given)})


if __name__ == "__main__":
    main()
