"""`geoprior probe`: find what a checkpoint was made from, and measure it on what it has not seen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geoprior.config import RunConfig, load_config
from geoprior.errors import ConfigError
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.probe.aim import Resets, unseen_states
from geoprior.probe.baselines import Lessons, lessons_of
from geoprior.probe.checkpoint import Measures, Trained, load_trained, measure, try_resets
from geoprior.probe.episodes import ProbeEpisodes, fresh_episodes, generated_source, stored_episodes
from geoprior.run_folder import saved_config
from geoprior.shards.reader import EpisodeStore
from geoprior.sim.workers import Setup
from geoprior.stages import DEMOS, SYNTHETIC
from geoprior.training.data import split_slots

EPISODES = 100
"""Of each motion, if not said otherwise."""
STATES = 160
"""Initial states to aim on, if not said otherwise."""
_LEVELS = 4  # a checkpoint lies in RUN/checkpoints/finetune/NAME
_PRETRAIN = "pretrain"


@dataclass(frozen=True)
class Wanted:
    """What to measure a checkpoint on.

    Attributes:
        data: Folder of shards, or one tar; None takes what the run says.
        episodes: Of each motion, at most.
        states: Initial states to aim on; 0 leaves the aim error out.
        robot: The arm to aim with; None takes the run's.
        task: What to aim at; None takes the run's.
        config: That of its run; None looks for it in the folders above the checkpoint.
    """

    data: Path | None = None
    episodes: int = EPISODES
    states: int = STATES
    robot: Choice | None = None
    task: Choice | None = None
    config: RunConfig | None = None


@dataclass(frozen=True)
class _Run:
    path: Path
    config: RunConfig


@dataclass(frozen=True)
class _Material:
    """Episodes to measure on, what a pose-only regressor learns from, and what is to be said of them."""

    episodes: ProbeEpisodes
    lessons: Lessons | None
    remarks: Sequence[str] = ()


def probe_checkpoint(checkpoint: Path, wanted: Wanted | None = None) -> Measures:
    """Measure a checkpoint.

    Without ``wanted.data`` a prior is measured on fresh synthetic episodes of its run's recipe. A prior that
    has none, and a fine-tuned policy, are measured on the episodes that their training held out, or, where it
    held none out, on those that it was trained on, which is said.

    Args:
        checkpoint: Its ``.safetensors`` file.
        wanted: What to measure on.

    Raises:
        ConfigError: There is no config of a run above the checkpoint and no data is given.
        DataError: The checkpoint or the data is damaged, or they are not of a kind.
    """
    wanted = wanted or Wanted()
    trained = load_trained(checkpoint)
    run = _run_of(checkpoint, wanted.config)
    material = _material(trained, run, wanted)
    with closing(material.episodes.source):
        resets, told = _resets(trained, run, wanted)
        remarks = [*material.remarks, *([told] if told else [])]
        return measure(trained, material.episodes, material.lessons, resets, remarks)


def _run_of(checkpoint: Path, config: RunConfig | None) -> _Run | None:
    if config is not None:
        return _Run(checkpoint.parent, config)
    for folder in list(checkpoint.resolve().parents)[:_LEVELS]:
        if found := saved_config(folder):
            return _Run(folder, load_config(found, (), plugins()))
    return None


def _material(trained: Trained, run: _Run | None, wanted: Wanted) -> _Material:
    if wanted.data is not None:
        return _stored(trained, run, wanted.data, wanted.episodes)
    if run is None:
        raise ConfigError(
            f"{trained.path}: no config.yaml of a run lies in the folders above, so what it was trained on "
            "is not known",
            "give episodes to measure on: --data FOLDER of shards; or copy the run folder with it",
        )
    if _is_prior(trained) and run.config.has_recipe:
        return _fresh(trained, run.config, wanted.episodes)
    return _stored(trained, run, _training_data(trained, run), wanted.episodes)


def _fresh(trained: Trained, config: RunConfig, count: int) -> _Material:
    episodes = fresh_episodes(config.generate, config.cameras, config.seed, count)
    skip = trained.skip_of(episodes.source, episodes.told)
    with closing(generated_source(config.generate, config.cameras, config.seed, count)) as taught:
        chunk = trained.header.features.chunk
        lessons = lessons_of(taught.poses, taught.actions, trained.normaliser, chunk, skip)
    return _Material(episodes, lessons)


def _stored(trained: Trained, run: _Run | None, folder: Path, count: int) -> _Material:
    store = EpisodeStore(folder)
    if store.digest != trained.header.data:
        told = f"{_up_to(count)} of {folder}, which are not the training's"
        others = ["the pose-only regression is fitted on four fifths of these episodes for the other fifth"]
        return _Material(stored_episodes(store, told, most=count), None, others)
    slots, aside = split_slots(len(store), _held_out(trained, run), _seed(trained))
    told = f"{_up_to(count)} of {folder}, which the training held out"
    remarks = []
    if not aside:
        told = f"{_up_to(count)} of {folder}, which the training saw"
        remarks = ["these episodes were trained on: give others for an honest measure (--data FOLDER)"]
    episodes = stored_episodes(store, told, aside or None, count)
    skip = trained.skip_of(episodes.source, told)
    poses, actions = (
        [numbers[slot] for slot in slots] for numbers in (episodes.source.poses, episodes.source.actions)
    )
    lessons = lessons_of(poses, actions, trained.normaliser, trained.header.features.chunk, skip)
    return _Material(episodes, lessons, remarks)


def _training_data(trained: Trained, run: _Run) -> Path:
    folder = run.path / (SYNTHETIC if _is_prior(trained) else DEMOS)
    if not folder.is_dir():
        raise ConfigError(
            f"{trained.path}: what it was trained on is not in its run ({folder})",
            "give episodes to measure on: --data FOLDER of shards",
        )
    return folder


def _resets(trained: Trained, run: _Run | None, wanted: Wanted) -> tuple[Resets | None, str]:
    if wanted.states == 0:
        return None, ""
    if run is None:
        return None, "no aim error: there is no run's config that names a robot and a task"
    config = run.config
    setup = Setup(
        wanted.robot or config.robot, wanted.task or config.task, config.cameras, config.evaluate.look
    )
    return try_resets(
        trained, setup, config.demos.control_rate, unseen_states(wanted.states, _used_states(config))
    )


def _used_states(config: RunConfig) -> Iterator[range]:
    yield config.evaluate.states
    for collected in (config.demos, config.same_environment):
        if collected is not None:
            yield range(collected.first_state, collected.first_state + collected.max_attempts)


def _is_prior(trained: Trained) -> bool:
    """Whether it is of pretraining; its JSON says ``pretrain``, ``pretrain/blind`` or ``finetune/...``."""
    return str(trained.header.details.get("run", _PRETRAIN)).partition("/")[0] == _PRETRAIN


def _seed(trained: Trained) -> int:
    seed = trained.header.details.get("seed", 0)
    return seed if isinstance(seed, int) else 0


def _held_out(trained: Trained, run: _Run | None) -> float:
    """The share of its episodes that the training held out; the run's config where the JSON has none."""
    config: Any = trained.header.details.get("config")
    if isinstance(config, Mapping) and isinstance(config.get("held_out"), int | float):
        return float(config["held_out"])
    if run is None:
        return 0.0
    section = run.config.pretrain if _is_prior(trained) else run.config.finetune
    return section.held_out


def _up_to(count: int) -> str:
    return f"up to {count} episodes of each motion"
