"""Heads that learn targets on the side: they make the trunk and the encoder say where things are.

They exist in pretraining alone: no checkpoint holds them, and nothing of a prediction depends on them.
"""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn

from geoprior.episode import HAND_AXES
from geoprior.policies.targets import UNIT, axis_of

_WIDTH = 32
"""Of what a head takes from each token: their number grows with the image, and the head must not."""


class TargetHeads(nn.Module):
    """One head on the image tokens as the trunk gives them, one on the tokens as the encoder gives them.

    Args:
        names: Of the T targets.
        dim: Width of the tokens.
        image_tokens: Of all cameras together.
        tokens: Of the encoder.
    """

    def __init__(self, names: Sequence[str], dim: int, image_tokens: int, tokens: int) -> None:
        super().__init__()
        self.trunk = _head(image_tokens, dim, len(names))
        self.encoder = _head(tokens, dim, len(names))
        self._in_hands = [place for place, name in enumerate(names) if axis_of(name) in HAND_AXES]

    def forward(
        self, image_tokens: Tensor, memory: Tensor, targets: Tensor
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Compare what the heads say with what is so.

        Args:
            image_tokens: (B, S, dim)
            memory: (B, tokens, dim)
            targets: (B, T) scaled, NaN where there is none.

        Returns:
            The mean of both heads' L1 over the targets that there are, and scalars to log: the same, that of
            each head, and by how many centimetres the encoder's head misplaces things along an axis of the
            hands' frames.
        """
        known = ~targets.isnan()
        wanted = targets.nan_to_num()
        errors = {
            name: (head(tokens).float() - wanted).abs() * known
            for name, head, tokens in (("trunk", self.trunk, image_tokens), ("encoder", self.encoder, memory))
        }
        count = known.sum().clamp_min(1)
        of_head = {name: error.sum() / count for name, error in errors.items()}
        l1 = 0.5 * (of_head["trunk"] + of_head["encoder"])
        near, counted = errors["encoder"][:, self._in_hands], known[:, self._in_hands]
        in_hands = 100.0 * UNIT * near.sum() / counted.sum().clamp_min(1)
        return l1, {
            "target_l1": l1,
            **{f"target_l1_{name}": value for name, value in of_head.items()},
            "target_hand_cm": in_hands,
        }


def _head(tokens: int, dim: int, targets: int) -> nn.Sequential:
    """(B, tokens, dim) to (B, targets); which token says something is where that is, so none is averaged."""
    narrow = nn.Sequential(nn.Linear(dim, _WIDTH), nn.ReLU(), nn.Flatten())
    return nn.Sequential(narrow, nn.Linear(tokens * _WIDTH, dim), nn.ReLU(), nn.Linear(dim, targets))
