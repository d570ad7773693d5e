"""Which episode stands where in a training on fresh ones: a pure function."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Turnover:
    """How fresh episodes take the places of old ones.

    The first ``keep`` epochs have the episodes ``0 .. slots - 1``. From then on every epoch renews one part
    in ``keep`` of the slots, in turn: the work is spread evenly over the training, where renewing all
    slots at once would make one epoch in ``keep`` slow. A first episode thus stays for ``keep`` to
    ``2 keep - 1`` epochs and a later one for ``keep``; it never comes back.

    Attributes:
        slots: Episodes of an epoch.
        keep: Epochs that an episode stays for.
    """

    slots: int
    keep: int

    def episode(self, number: int) -> int:
        """The episode, counted from 0, that a number of the training stands for."""
        epoch, slot = divmod(number, self.slots)
        delay = slot * self.keep // self.slots
        renewals = max(0, (epoch - delay) // self.keep)
        return renewals * self.slots + slot
