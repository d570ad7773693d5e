"""All measures of one checkpoint."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from geoprior.errors import DataError, MachineError
from geoprior.hooks.manager import plugins
from geoprior.policies.checkpoint import CheckpointHeader, load_checkpoint
from geoprior.policies.normalise import Normaliser
from geoprior.policies.predictor import LoadedPredictor
from geoprior.policies.tensors import fill
from geoprior.probe.aim import Resets, aim_error, require_the_same, see_resets
from geoprior.probe.linear import probe_episodes, probe_resets
from geoprior.probe.sight import ALL, Sight, judgement
from geoprior.probe.vision import VisionProbe
from geoprior.training.machine import Machine

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from torch import nn

    from geoprior.probe.baselines import Lessons
    from geoprior.probe.episodes import ProbeEpisodes
    from geoprior.sim.workers import Setup
    from geoprior.sources.source import Source

_HERE = Machine("cpu", "fp32", 0)
"""Where a checkpoint is measured; as many threads as torch has."""


@dataclass(frozen=True)
class Trained:
    """A checkpoint in memory.

    Attributes:
        path: Of its weights.
        header: What its JSON says.
        policy: With its weights, in evaluation mode.
    """

    path: Path
    header: CheckpointHeader
    policy: nn.Module

    @property
    def normaliser(self) -> Normaliser:
        """Of its training."""
        return self.header.normaliser

    @property
    def predictor(self) -> LoadedPredictor:
        """The same policy, from observations to commands."""
        return LoadedPredictor(self.policy, self.header.features, self.header.fps, self.normaliser)

    def skip_of(self, source: Source, where: str) -> int:
        """Steps of a source's episodes in one of the policy's; the source must show what the policy looks at.

        Args:
            source: The episodes.
            where: What they are, for the message.

        Raises:
            DataError: Other hands, cameras, image size or rate; the key is named.
        """
        features = self.header.features
        for what, found in (
            ("hands", source.hands),
            ("cameras", source.cameras),
            ("image size", source.image_size),
        ):
            require_the_same(f"{self.path}: {where}", what, getattr(features, what.replace(" ", "_")), found)
        skip = round(source.fps / self.header.fps)
        if skip < 1 or abs(source.fps - skip * self.header.fps) > 1e-6 * source.fps:
            raise DataError(
                f"{self.path}: {where}: key 'fps': {source.fps:g} time steps a second, and the policy acts "
                f"{self.header.fps:g} times a second",
                "give data (--data) whose rate is a multiple of the policy's",
            )
        return skip


@dataclass(frozen=True)
class Measures:
    """What was measured of a checkpoint.

    Attributes:
        motions: Errors by motion, ``all`` first; see `geoprior.probe.sight.Sight`.
        aim: See `geoprior.probe.aim.aim_error`; None where nothing was aimed at.
        linear_probe_cm: See `geoprior.probe.linear.errors_cm`; None where it could not be measured.
        remarks: What it was measured on, and what was not measured and why.
    """

    motions: Mapping[str, Sight]
    aim: Mapping[str, float] | None
    linear_probe_cm: Mapping[str, float] | None
    remarks: Sequence[str]

    def as_tree(self) -> dict[str, Any]:
        """As ``geoprior probe --json`` prints it."""
        return {
            "motions": {name: asdict(sight) for name, sight in self.motions.items()},
            "aim": dict(self.aim) if self.aim is not None else None,
            "linear_probe_cm": dict(self.linear_probe_cm) if self.linear_probe_cm is not None else None,
        }

    def as_lines(self) -> list[str]:
        """As it prints it for people."""
        heads = ("true", "shuffled", "black", "still", "pose_only", "vision_gain", "vision_gain_se")
        lines = [judgement(self.motions[ALL]), "", "normalised L1" + "".join(f"{head:>16}" for head in heads)]
        for name, sight in self.motions.items():
            numbers = asdict(sight)
            lines.append(f"{name:<13}" + "".join(f"{_number(numbers[head]):>16}" for head in heads))
        for title, found in (
            ("aim error, from the chunk to the object (cm)", self.aim),
            (
                "the object's place in an image, read from the trunk by a linear map, mean error (cm)",
                self.linear_probe_cm,
            ),
        ):
            if found is not None:
                told = ", ".join(f"{name.removesuffix('_cm')} {value:.1f}" for name, value in found.items())
                lines.append(f"{title}: {told}")
        return [*lines, "", *self.remarks]


def load_trained(path: Path) -> Trained:
    """Load a checkpoint.

    Raises:
        DataError: The pair is missing, damaged or foreign, or does not fit its own description.
        ConfigError: The policy is of a plug-in that is not installed.
    """
    header, tensors = load_checkpoint(path)
    policy: nn.Module = plugins().build("policy", header.policy, header.features)
    fill(policy, tensors, path)
    return Trained(path, header, policy.eval())


def measure(
    trained: Trained,
    episodes: ProbeEpisodes,
    lessons: Lessons | None = None,
    resets: Resets | None = None,
    remarks: Sequence[str] = (),
) -> Measures:
    """Measure a checkpoint.

    Args:
        trained: The checkpoint.
        episodes: What its predictions are compared with.
        lessons: See `VisionProbe`.
        resets: What it aims on, and what the linear probe reads; None leaves the aim out, and the probe reads
            the episodes, if they say where the object is.
        remarks: To go with the result.

    Raises:
        DataError: The episodes are not of the checkpoint's kind, or too few.
        NumericalError: The policy says numbers that are not finite.
    """
    skip = trained.skip_of(episodes.source, episodes.told)
    probe = VisionProbe(episodes, trained.header.features, trained.normaliser, skip, lessons)
    motions = probe.measure(trained.policy, _HERE, black=True)
    if resets is None:
        linear = probe_episodes(trained.policy, probe, _HERE)
    else:
        linear = probe_resets(trained.policy, resets, trained.header.features)
    where = "the episodes" if resets is None else "the initial states"
    said = [f"measured on {episodes.told}", *remarks]
    if linear is not None:
        said.append(f"the linear probe reads the images of {where}")
    aim = aim_error(trained.predictor, resets) if resets is not None else None
    return Measures(motions, aim, linear, said)


def try_resets(
    trained: Trained, setup: Setup, control_rate: int, states: Sequence[int]
) -> tuple[Resets | None, str]:
    """The resets to aim on, or None and why not.

    Raises:
        GeopriorError: The world cannot be built, or the policy was not trained for it.
    """
    try:
        resets = see_resets(setup, control_rate, states, trained.header.features)
    except MachineError as error:
        return None, f"no aim error: {error.message}"
    if resets is None:
        return None, f"no aim error: task {setup.task.name!r} has no object to aim at"
    return resets, (
        f"aim error on {len(resets)} initial states of {setup.task.name} on {setup.robot.name} that neither "
        "demonstrations nor trials use"
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
