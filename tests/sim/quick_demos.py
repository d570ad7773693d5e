"""Demonstrations without physics and without an order, for the tests of what collects them."""

from __future__ import annotations

import random

import pytest

from geoprior.sim import demos


class Shuffled:
    """An executor that finishes its work in a random order, and may be interrupted."""

    def __init__(self, seed: int, stop_after: int = 10**9) -> None:
        self.random, self.stop_after, self.ran = random.Random(seed), stop_after, 0

    def run(self, function, items):
        order = list(enumerate(items))
        # As with a pool, work starts in order, and what runs at the same time ends in any order.
        for first in range(0, len(order), 4):
            batch = order[first : first + 4]
            self.random.shuffle(batch)
            for position, item in batch:
                if self.ran == self.stop_after:
                    raise KeyboardInterrupt
                self.ran += 1
                yield position, function(item)


@pytest.fixture
def fast_episodes(env, monkeypatch):
    """Attempts without physics: one real observation, and every third attempt fails."""

    def record(_env, task):
        env.reset(task.state_seed)
        if task.number % 3 == 1:
            return None, "dropped", 7
        seen = env.observe()
        episode = demos.Episode(
            header=demos._header(env, task, 1),
            pose=seen.pose[None],
            action=seen.pose[None],
            images={name: frame[None] for name, frame in seen.images.items()},
        )
        return episode, "", 1

    monkeypatch.setattr(demos, "record_expert", record)
    monkeypatch.setattr(demos, "environment", lambda *_: env)
