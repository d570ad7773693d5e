"""The scripted lift: both hands over the handles, down, close, and up together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import POSE_SIZE
from geoprior.sim.experts.grasp import CLOSING_TENTHS
from geoprior.sim.experts.path import Waypoint, commands_in, follow, hand_down

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior_bimanual.pot_world import PotWorld


NEAR = 0.008
"""Metres from its goal within which a hand is there."""

PATIENCE = 12
"""Tenths of a second that the hands wait for each other to be there, at most."""


def pot_expert(
    world: PotWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies from one to the next: speed, height of the approach, where along the bar and how deep each
    hand grasps, how high the pot is lifted, and the pauses.
    """
    rotation, speed = hand_down(world.pot_yaw()), rng.uniform(0.14, 0.20)
    along_bar = rotation.as_matrix()[:, 1]
    lift = np.array([0.0, 0.0, rng.uniform(0.10, 0.14)])
    wait = int(rng.integers(1, 3))
    phases: list[list[Waypoint]] = [[], [], [], []]
    for handle in world.handles().values():
        depth = np.array([0.0, 0.0, rng.uniform(-0.006, 0.002)])
        position = handle + rng.uniform(-0.01, 0.01) * along_bar + depth
        above = position + np.array([*rng.normal(0.0, 0.006, 2), rng.uniform(0.08, 0.11)])
        phases[0].append(Waypoint(above, rotation, 0.0, speed))
        phases[1].append(Waypoint(position, rotation, 0.0, 0.6 * speed, wait=wait))
        phases[2].append(Waypoint(position, rotation, 1.0, speed, wait=CLOSING_TENTHS))
        phases[3].append(Waypoint(position + lift, rotation, 1.0, 0.7 * speed, wait=6))
    last = start
    for number, phase in enumerate(phases):
        for command in together(last, phase, world.control_freq):
            last = command
            yield last
        if number < 2:
            yield from _settle(world, last)


def _settle(world: PotWorld, command: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    """Wait until no hand swings about its goal any more: after a long move some arms do, by centimetres."""
    goals = command.reshape(-1, POSE_SIZE)[:, :3]
    for _ in range(commands_in(PATIENCE, world.control_freq)):
        places = [world.transform_hand_to_workspace(hand)[:3, 3] for hand in world.hands]
        if np.linalg.norm(places - goals, axis=1).max() < NEAR:
            return
        yield command


def together(
    start: NDArray[np.float32], waypoints: Sequence[Waypoint], control_rate: int
) -> Iterator[NDArray[np.float32]]:
    """Commands (8 x hands) of hands that begin at the same time; the first one there waits for the others.

    Args:
        start: (8 x hands) pose vectors to begin at.
        waypoints: One for each hand.
        control_rate: Commands a second.
    """
    poses = start.reshape(-1, POSE_SIZE)
    ways = [list(follow(pose, [to], control_rate)) for pose, to in zip(poses, waypoints, strict=True)]
    for step in range(max(map(len, ways))):
        yield np.concatenate([way[min(step, len(way) - 1)] for way in ways])
