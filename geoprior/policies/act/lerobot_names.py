"""How LeRobot 0.4.4 names ACT's tensors and options, and how geoprior does.

Tensors differ in name only: shapes, the packing of queries, keys and values, and the order of tokens are the
same. Two kinds have no counterpart: LeRobot keeps the table `POSITION_TABLE`, which is computed here, and a
trainable batch norm counts its batches, which nothing reads.
"""

from __future__ import annotations

from collections.abc import Mapping

from geoprior.errors import DataError

PREFIX = "model."
"""LeRobot's policy holds its network in this attribute."""
POSITION_TABLE = "model.vae_encoder_pos_enc"
"""(1, 2 + chunk, dim): the sinusoids of the action encoder's tokens."""
COUNTER = ".num_batches_tracked"
"""How the names of batch norms' counters end."""

MODULES = {
    "trunk": "backbone",
    "image_proj": "encoder_img_feat_input_proj",
    "pose_proj": "encoder_robot_state_input_proj",
    "latent_proj": "encoder_latent_input_proj",
    "token_position": "encoder_1d_feature_pos_embed.weight",
    "encoder": "encoder",
    "decoder": "decoder",
    "query_position": "decoder_pos_embed.weight",
    "action_head": "action_head",
    "vae_cls": "vae_encoder_cls_embed.weight",
    "vae_pose_proj": "vae_encoder_robot_state_input_proj",
    "vae_action_proj": "vae_encoder_action_input_proj",
    "vae_encoder": "vae_encoder",
    "vae_head": "vae_encoder_latent_output_proj",
}
"""The network's parts: geoprior's name to LeRobot's, without `PREFIX`. Within a part, names are the same."""

OPTIONS = {
    "chunk": "chunk_size",
    "dim": "dim_model",
    "heads": "n_heads",
    "ffn": "dim_feedforward",
    "encoder_layers": "n_encoder_layers",
    "decoder_layers": "n_decoder_layers",
    "vae_layers": "n_vae_encoder_layers",
    "latent": "latent_dim",
    "dropout": "dropout",
    "kl_weight": "kl_weight",
}
"""Keys of `ActConfig` to those of LeRobot's ``ACTConfig``. The rest is fixed there: ``padding`` is `all`,
``trunk_norm`` is `frozen`, ``trunk_width`` is 64."""


def to_lerobot(name: str) -> str:
    """The name in LeRobot's state dict of a tensor in geoprior's.

    Raises:
        DataError: ACT has no such tensor, or LeRobot has none like it.
    """
    if name.endswith(COUNTER):
        raise DataError(f"tensor {name!r} has no counterpart in LeRobot", "leave the counters out")
    return PREFIX + _rename(name, MODULES)


def from_lerobot(name: str) -> str:
    """The inverse of `to_lerobot`.

    Raises:
        DataError: LeRobot's ACT has no such tensor, or geoprior has none like it.
    """
    if not name.startswith(PREFIX):
        raise DataError(f"tensor {name!r} is not of LeRobot's ACT: its names begin with {PREFIX!r}")
    return _rename(name.removeprefix(PREFIX), {theirs: ours for ours, theirs in MODULES.items()})


def _rename(name: str, modules: Mapping[str, str]) -> str:
    for old, new in modules.items():
        if name == old or name.startswith(f"{old}."):
            return new + name[len(old) :]
    raise DataError(f"tensor {name!r} is none of ACT's", f"they begin with: {', '.join(modules)}")
