"""An arm of boxes that carries a hand: a column, two links and a wrist, for the third-person camera to see.

The column stands behind the workspace, on the side of minus x, as robots do. Two links of fixed lengths reach
from its top to the wrist, which is rigid with the hand; their elbow points up, or aside by the arm's swivel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.se3 import cross, make_transform
from geoprior.scene.mesh import Mesh, box
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.config import ArmConfig
    from geoprior.scene.floor import Floor
    from geoprior.scene.hand import Hand

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """The arm of one hand.

    Attributes:
        foot: (3,) where its column stands on the floor, world, metres.
        shoulder: Height of the column, metres.
        thickness: Of its links, metres.
        wrist: Length of the wrist, behind the hand's cube, metres.
        upper: Share of the first link in the length of both.
        slack: Length of both links, as a multiple of the farthest that the wrist ever is from the shoulder.
        swivel: By how much the elbow points aside from up, radians.
        points: Along an edge of a box.
    """

    foot: FloatArray
    shoulder: float
    thickness: float
    wrist: float
    upper: float
    slack: float
    swivel: float
    points: int

    def boxes(self, hand: Hand, transforms_hand_to_world: FloatArray) -> Iterator[tuple[Mesh, FloatArray]]:
        """The arm while the hand goes its way (N, 4, 4): boxes, and their poses (4, 4) or (N, 4, 4)."""
        half, root = 0.5 * self.thickness, self.foot + self.shoulder * WORLD_UP
        yield _beam(half, self.shoulder), make_transform(np.eye(3), self.foot)
        behind = hand.setback + hand.cube
        wrist = box(np.array([-0.5, -0.5, -1.0]), np.array([0.5, 0.5, 0.0]))
        size = np.array([0.8 * self.thickness, 0.8 * self.thickness, self.wrist])
        place = np.array([0.0, 0.0, -behind])
        yield Mesh(wrist.vertices * size + place, wrist.faces), transforms_hand_to_world
        ends = transforms_hand_to_world[:, :3, 3] - (behind + self.wrist) * transforms_hand_to_world[:, :3, 2]
        elbows, across, lengths = self._elbows(root, ends)
        for start, end, length in ((root[None], elbows, lengths[0]), (elbows, ends, lengths[1])):
            along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
            frames = np.stack([across, cross(along, across), along], axis=-1)
            yield _beam(half, length), make_transform(frames, np.broadcast_to(start, end.shape))

    def _elbows(
        self, root: FloatArray, ends: FloatArray
    ) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
        """(N, 3) elbows, (N, 3) unit normals of the arm's plane, and the links' lengths."""
        reach = np.linalg.norm(ends - root, axis=1, keepdims=True)
        both = self.slack * float(reach.max())
        first, second = self.upper * both, (1.0 - self.upper) * both
        towards = (ends - root) / reach
        level = cross(towards, np.broadcast_to(WORLD_UP, towards.shape))
        level /= np.linalg.norm(level, axis=1, keepdims=True)
        up = cross(level, towards)
        bend = np.cos(self.swivel) * up + np.sin(self.swivel) * level
        ahead = (first**2 - second**2 + reach**2) / (2.0 * reach)
        aside = np.sqrt(np.maximum(first**2 - ahead**2, 0.0))
        return root + ahead * towards + aside * bend, cross(towards, bend), (first, second)


def draw_arm(config: ArmConfig, floor: Floor, rng: np.random.Generator) -> Arm:
    """Draw where an arm stands and how it is built."""
    distance, bearing = uniform(rng, config.distance), np.pi + np.radians(uniform(rng, config.bearing))
    return Arm(
        foot=np.array([distance * np.cos(bearing), distance * np.sin(bearing), floor.height]),
        shoulder=uniform(rng, config.shoulder),
        thickness=uniform(rng, config.thickness),
        wrist=uniform(rng, config.wrist),
        upper=uniform(rng, config.upper),
        slack=uniform(rng, config.slack),
        swivel=float(np.radians(uniform(rng, config.swivel))),
        points=config.points,
    )


def _beam(half: float, length: float) -> Mesh:
    """A box from the origin along z."""
    return box(np.array([-half, -half, 0.0]), np.array([half, half, length]))
