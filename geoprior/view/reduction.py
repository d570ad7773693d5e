"""Pictures in few colours, for GIF and for small PNG."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from numpy.typing import NDArray

_COLOURS = 256  # a GIF has no more
_EXACT = 64
_SAMPLED = 8
_PACKING = np.array([65536, 256, 1])  # three bytes as one number, which is sorted far faster


def reduced(pictures: Sequence[NDArray[np.uint8]]) -> list[Image.Image]:
    """Pictures in 256 colours that they share: the commonest as they are, the others by median cut.

    A palette for each frame of a film would let still parts flicker and double the file.

    Args:
        pictures: (H, W, 3) uint8 RGB each; one at least.
    """
    some = [picture.reshape(-1, 3) for picture in pictures[:: -(-len(pictures) // _SAMPLED)]]
    packed, counts = np.unique(np.concatenate(some) @ _PACKING, return_counts=True)
    by_count = (packed[np.argsort(-counts, kind="stable"), None] // _PACKING % 256).astype(np.uint8)
    common, others = by_count[:_EXACT], by_count[_EXACT:]
    table = common.ravel().tolist()
    if len(others):
        cut = Image.fromarray(others[None]).quantize(_COLOURS - len(common)).getpalette() or []
        table += cut[: 3 * (_COLOURS - len(common))]
    palette = Image.new("P", (1, 1))
    palette.putpalette(table)
    return [Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
