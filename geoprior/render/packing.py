"""Binary frames, eight pixels a byte: what a renderer gives and what a 1-bit PNG holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def pack_frames(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pack frames.

    Args:
        frames: (..., H, W) uint8; whatever is not 0 is white.

    Returns:
        (..., H, ceil(W / 8)) uint8; the leftmost pixel of a byte is its highest bit, what a row's last byte
        has too many is 0.
    """
    return np.packbits(frames, axis=-1)


def unpack_frames(packed: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Undo `pack_frames`.

    Args:
        packed: (..., H, ceil(W / 8)) uint8.
        width: W.

    Returns:
        (..., H, W) uint8, 0 or 255.
    """
    bits = np.unpackbits(packed, axis=-1, count=width)
    return np.multiply(bits, np.uint8(255), out=bits)
