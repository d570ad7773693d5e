"""The stage that collects scripted demonstrations: N successes, the same ones whatever the workers."""

from __future__ import annotations

import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior import __version__
from geoprior.episode import Episode, EpisodeHeader
from geoprior.errors import ConfigError, DataError
from geoprior.files import read_json, sha256_json, write_json
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.progress import track
from geoprior.shards.manifest import Manifest, ShardRecord, record_of, write_manifest
from geoprior.shards.writer import write_shard
from geoprior.sim.config import DemosConfig
from geoprior.sim.judge import GAVE_UP, UNSTABLE, Judge
from geoprior.sim.workers import Setup, environment

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from geoprior.hooks.types import Executor
    from geoprior.sim.environment import Environment

ATTEMPTS = "attempts.json"
SCRATCH = "attempts"
ENOUGH = "enough"
"""A file among the notes that calls off the attempts which are queued in workers already."""
SOURCE = "simulated"
REVISION = 2
"""Raised when the same config and seed come to give other demonstrations."""


@dataclass(frozen=True)
class AttemptTask:
    """One attempt at a demonstration: a unit of work that any process can do.

    Attributes:
        number: Of the attempt, from 0.
        state_seed: Initial state.
        setup: What is simulated, resolved.
        control_rate: Commands a second.
        seed: Root seed.
        out: Folder of the shards.
    """

    number: int
    state_seed: int
    setup: Setup
    control_rate: int
    seed: int
    out: Path

    @property
    def shard(self) -> Path:
        """Where the demonstration goes if it succeeds."""
        return self.out / f"{self.key}.tar"

    @property
    def key(self) -> str:
        """Of the episode."""
        return f"{self.setup.task.name}-{self.number:06d}"

    @property
    def note(self) -> Path:
        """Where its outcome is kept until the stage is done."""
        return self.out / SCRATCH / f"{self.number:06d}.json"

    @property
    def recipe(self) -> str:
        """Hash of everything that decides the attempt."""
        parts = (self.setup.robot, self.setup.task, self.setup.cameras, self.setup.look)
        tree = [part.model_dump(mode="json") for part in parts]
        return sha256_json([REVISION, *tree, self.control_rate, self.seed, self.number, self.state_seed])


@dataclass(frozen=True)
class Attempt:
    """How one attempt went.

    Attributes:
        number: From 0.
        state_seed: Initial state.
        success: Whether it became a demonstration.
        reason: Why not; empty on success.
        steps: Commands given.
        recipe: Hash of what decided it.
    """

    number: int
    state_seed: int
    success: bool
    reason: str
    steps: int
    recipe: str


def collect(
    config: DemosConfig,
    *,
    robot: Choice,
    task: Choice,
    cameras: CamerasConfig,
    seed: int,
    executor: Executor,
    out: Path,
) -> Manifest:
    """Collect demonstrations, or what is missing of them: not made yet, or lost.

    Attempts are numbered, and the first ``config.episodes`` successes in that order are the result: it does
    not depend on the number of workers or on interruptions. Every attempt is on disk when it ends.

    Args:
        config: How many, and from which initial states.
        robot: Choice of the arm.
        task: Choice of the task.
        cameras: Lenses and size of the frames.
        seed: Root seed, for the experts' variation.
        executor: Runs attempts side by side.
        out: Folder of the shards (one demonstration each), their manifest, and `ATTEMPTS`: every attempt up
            to the last one taken, failures among them.

    Raises:
        ConfigError: Too few attempts succeed, or a name or an option is unknown.
        DataError: The folder cannot be written, or holds demonstrations of another config.
        MachineError: No GL, or a worker died; the same call goes on.
    """
    setup = Setup(robot, task, cameras, config.look)
    tasks = [
        AttemptTask(number, config.first_state + number, setup, config.control_rate, seed, out)
        for number in range(config.max_attempts)
    ]
    done = _known(tasks, out)
    _run(tasks, done, config.episodes, executor)
    taken = _taken(done, config.episodes)
    if len(taken) < config.episodes:
        raise ConfigError(
            f"task {task.name!r} on {robot.name!r}: {len(taken)} of {config.max_attempts} attempts succeeded "
            f"and {config.episodes} are wanted; reasons: {_reasons(done)}",
            "raise attempts_per_episode, or make the task easier",
        )
    return _finish(tasks, [done[number] for number in range(taken[-1] + 1)], taken, out)


def attempt(task: AttemptTask) -> Attempt:
    """Make one attempt; a success is a shard on disk when this returns, and either is a note.

    An attempt that is called off leaves nothing, and nobody reads what it returns.
    """
    if task.note.with_name(ENOUGH).exists():
        return Attempt(task.number, task.state_seed, success=False, reason="", steps=0, recipe=task.recipe)
    env = environment(task.setup, task.control_rate)
    episode, reason, steps = record_expert(env, task)
    if episode is not None:
        write_shard(task.shard, [episode])
    result = Attempt(task.number, task.state_seed, episode is not None, reason, steps, task.recipe)
    write_json(task.note, asdict(result))
    return result


def record_expert(env: Environment, task: AttemptTask) -> tuple[Episode | None, str, int]:
    """Run the expert once and keep what a policy would have seen.

    Returns:
        The episode if it succeeded, the reason if it did not, and the number of commands.
    """
    from geoprior.sim.environment import UnstablePhysicsError

    env.reset(task.state_seed)
    judge = Judge(env)
    observations, commands = [], []
    verdict: str | None = None
    for command in _until_it_has_held(env.expert(task.seed), judge):
        observations.append(env.observe())
        commands.append(command)
        try:
            env.step(command)
        except UnstablePhysicsError:
            return None, UNSTABLE, len(commands)
        verdict = judge.look()
        if verdict:
            return None, verdict, len(commands)
    if verdict is None:
        return None, GAVE_UP, len(commands)
    names = sorted(observations[0].images)
    episode = Episode(
        header=_header(env, task, len(commands)),
        pose=np.stack([observation.pose for observation in observations]),
        action=np.stack(commands),
        images={name: np.stack([each.images[name] for each in observations]) for name in names},
    )
    return episode, "", len(commands)


def _until_it_has_held(expert: Iterator[NDArray[np.float32]], judge: Judge) -> Iterator[NDArray[np.float32]]:
    """The expert's commands; the last repeats while what it has reached must hold on."""
    command: NDArray[np.float32] | None = None
    for command in expert:
        yield command
    while command is not None and judge.waits:
        yield command


def _header(env: Environment, task: AttemptTask, steps: int) -> EpisodeHeader:
    return EpisodeHeader(
        key=task.key,
        source=SOURCE,
        motion=task.setup.task.name,
        index=task.number,
        seed=task.state_seed,
        fps=task.control_rate,
        steps=steps,
        hands=list(env.hands),
        cameras=env.camera_headers(),
        generator=f"geoprior {__version__}",
        details={
            "robot": task.setup.robot.model_dump(mode="json"),
            "task": task.setup.task.model_dump(mode="json"),
            "look": task.setup.look.model_dump(mode="json"),
            "root_seed": task.seed,
        },
    )


def _run(tasks: list[AttemptTask], done: dict[int, Attempt], wanted: int, executor: Executor) -> None:
    """Attempt in order until enough of the first ones are known to have succeeded."""
    missing = [task for task in tasks if task.number not in done]
    enough = tasks[0].note.with_name(ENOUGH)
    enough.unlink(missing_ok=True)
    with track("demos", wanted, "demonstrations", done=len(_taken(done, wanted))) as progress:
        if len(_taken(done, wanted)) >= wanted or not missing:
            return
        results = executor.run(attempt, missing)
        try:
            for position, result in results:
                before = len(_taken(done, wanted))
                done[missing[position].number] = result
                progress.advance(len(_taken(done, wanted)) - before, failed=_failures(done))
                if len(_taken(done, wanted)) >= wanted:
                    enough.touch()
                    return
        finally:
            # What runs ahead of the last demonstration wanted is called off.
            close = getattr(results, "close", None)
            if close is not None:
                close()


def _taken(done: dict[int, Attempt], wanted: int) -> list[int]:
    """Numbers of the first successes, as far as all attempts before them are known."""
    taken: list[int] = []
    number = 0
    while number in done and len(taken) < wanted:
        if done[number].success:
            taken.append(number)
        number += 1
    return taken


def _failures(done: dict[int, Attempt]) -> int:
    return sum(not each.success for each in done.values())


def _reasons(done: dict[int, Attempt]) -> str:
    reasons = [each.reason for each in done.values() if not each.success]
    return ", ".join(f"{reasons.count(reason)} x {reason}" for reason in sorted(set(reasons)))


def _known(tasks: list[AttemptTask], out: Path) -> dict[int, Attempt]:
    """What earlier calls know; a success whose shard is not there is one to make again."""
    known = _listed(tasks, out) if (out / ATTEMPTS).exists() else [_kept(task) for task in tasks]
    return {
        each.number: each
        for each in known
        if each and (not each.success or tasks[each.number].shard.exists())
    }


def _kept(task: AttemptTask) -> Attempt | None:
    """What an earlier, interrupted run knows of an attempt."""
    if not task.note.is_file():
        return None
    return _parse(task, read_json(task.note), task.note)


def _parse(task: AttemptTask, tree: Any, source: Path) -> Attempt:
    try:
        found = Attempt(**tree)
    except TypeError as error:
        raise DataError(f"{source}: not an attempt's record", f"delete {task.out}") from error
    if found.recipe != task.recipe:
        raise DataError(
            f"{source}: attempt {task.number} was made with another config",
            f"delete {task.out}, or choose another folder",
        )
    return found


def _finish(tasks: list[AttemptTask], attempts: list[Attempt], taken: list[int], out: Path) -> Manifest:
    wanted = {tasks[number].shard for number in taken}
    for path in sorted(out.glob("*.tar")):
        if path not in wanted:
            path.unlink()
    records: list[ShardRecord] = [record_of(path) for path in sorted(wanted)]
    manifest = write_manifest(out, records)
    write_json(out / ATTEMPTS, [asdict(each) for each in attempts])
    shutil.rmtree(out / SCRATCH, ignore_errors=True)
    return manifest


def _listed(tasks: list[AttemptTask], out: Path) -> list[Attempt]:
    """The attempts of a collection that was finished."""
    tree = read_json(out / ATTEMPTS)
    if not isinstance(tree, list) or len(tree) > len(tasks):
        raise DataError(f"{out / ATTEMPTS}: made with another config", f"delete {out}")
    return [_parse(task, each, out / ATTEMPTS) for task, each in zip(tasks, tree, strict=False)]
