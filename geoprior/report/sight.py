"""What the page says of the prior's sight, from the log of pretraining."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from geoprior.probe.sight import ALL, REMEDY, Sight, from_metrics, judgement, warning
from geoprior.report.losses import read_entries


@dataclass(frozen=True)
class SightCurve:
    """The prior's sight at the checkpoints of its training.

    Attributes:
        epochs: Of each checkpoint, rising.
        measured: By motion, at each checkpoint.
    """

    epochs: Sequence[float]
    measured: Sequence[Mapping[str, Sight]]

    @property
    def last(self) -> Mapping[str, Sight]:
        """At the last checkpoint, from which fine-tuning begins."""
        return self.measured[-1]

    @property
    def lines(self) -> dict[str, list[float]]:
        """The errors over all motions by checkpoint, by what they are of."""
        overall = [measured[ALL] for measured in self.measured]
        return {
            "true images": [sight.true for sight in overall],
            "another's images": [sight.shuffled for sight in overall],
            "standing still": [sight.still for sight in overall],
            "pose alone": [sight.pose_only for sight in overall],
        }

    @property
    def sentence(self) -> str:
        """What a newcomer should take from it."""
        return judgement(self.last[ALL]).replace("This policy", "The prior")

    @property
    def caution(self) -> str:
        """What is wrong and what to do, or an empty string."""
        text = warning(self.last)
        return f"{text[:1].upper()}{text[1:]}. What to do: {REMEDY}." if text else ""


def read_sight(log: Path) -> SightCurve | None:
    """Read it from a ``log.jsonl``; None where nothing of it was logged.

    Raises:
        DataError: The file cannot be read.
    """
    entries, _ = read_entries(log)
    found = [(entry, measured) for entry in entries if ALL in (measured := from_metrics(entry))]
    if not found:
        return None
    epochs = [float(entry.get("epoch", entry["step"])) for entry, _ in found]
    return SightCurve(epochs, [measured for _, measured in found])
