"""The data that the geometric data set is compared with: demonstrations of many tasks in simulation.

The paper's same-environment condition: the prior is learned from as many episodes as the geometric data set
has, which look and move as the downstream ones do.
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Any

from geoprior.errors import DataError
from geoprior.files import read_json, sha256_json, write_json
from geoprior.shards.manifest import MANIFEST, Manifest, ShardRecord, read_manifest, write_manifest
from geoprior.sim.config import DemosConfig
from geoprior.sim.demos import ATTEMPTS, REVISION, collect

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.hooks.types import Executor
    from geoprior.options import Choice
    from geoprior.sim.config import SameEnvironmentConfig

PARTS = "parts"
MIXTURE = "mixture.json"


def collect_mixture(
    config: SameEnvironmentConfig, *, cameras: CamerasConfig, seed: int, executor: Executor, out: Path
) -> Manifest:
    """Collect demonstrations of every task, or what is missing of them: not made yet, or lost.

    Args:
        config: Which arm and tasks, and how many episodes in all.
        cameras: Lenses and size of the frames.
        seed: Root seed, for the experts' variation.
        executor: Runs attempts side by side; the bytes do not depend on it.
        out: Folder of the shards (one demonstration each), their manifest, and `MIXTURE`: for each task its
            attempts, failures among them.

    Raises:
        GeopriorError: See `geoprior.sim.demos.collect`.
        DataError: The folder holds other data.
    """
    recipe = sha256_json([REVISION, config.model_dump(mode="json"), cameras.model_dump(mode="json"), seed])
    if (out / MANIFEST).exists() or (out / MIXTURE).exists():
        attempts = _attempts(recipe, [task.name for task in config.tasks], out)
        if _is_whole(out):
            shutil.rmtree(out / PARTS, ignore_errors=True)
            return read_manifest(out)
        _take_apart(attempts, out)
    parts = {
        task.name: collect(
            DemosConfig(
                episodes=episodes,
                first_state=config.first_state,
                attempts_per_episode=config.attempts_per_episode,
                control_rate=config.control_rate,
            ),
            robot=config.robot,
            task=task,
            cameras=cameras,
            seed=seed,
            executor=executor,
            out=out / PARTS / task.name,
        )
        for task, episodes in shares(config)
    }
    return _finish(recipe, parts, out)


def shares(config: SameEnvironmentConfig) -> list[tuple[Choice, int]]:
    """How many episodes each task gives: as equal as can be, the first ones one more."""
    each, more = divmod(config.episodes, len(config.tasks))
    return [(task, each + (place < more)) for place, task in enumerate(config.tasks)]


def _finish(recipe: str, parts: dict[str, Manifest], out: Path) -> Manifest:
    """Bring all shards into one folder."""
    attempts = {name: read_json(out / PARTS / name / ATTEMPTS) for name in parts}
    write_json(out / MIXTURE, {"recipe": recipe, "attempts": attempts})
    records: list[ShardRecord] = []
    for name, manifest in parts.items():
        records.extend(manifest.shards)
        for record in manifest.shards:
            (out / PARTS / name / record.file).rename(out / record.file)
    manifest = write_manifest(out, records)
    shutil.rmtree(out / PARTS)
    return manifest


def _attempts(recipe: str, tasks: Sequence[str], out: Path) -> dict[str, Any]:
    """Of each task. Their names become folders, so that only those of the config are taken."""
    tree = read_json(out / MIXTURE) if (out / MIXTURE).exists() else None
    attempts = tree.get("attempts") if isinstance(tree, dict) and tree.get("recipe") == recipe else None
    if not isinstance(attempts, dict) or sorted(attempts) != sorted(tasks):
        raise DataError(f"{out}: holds other data than is wanted", f"delete {out}, or choose another folder")
    return attempts


def _is_whole(out: Path) -> bool:
    return (out / MANIFEST).exists() and all(
        (out / record.file).exists() for record in read_manifest(out).shards
    )


def _take_apart(attempts: dict[str, Any], out: Path) -> None:
    """Give every task's folder its shards back: moving them was interrupted, or some are lost."""
    for name, of_task in attempts.items():
        folder = out / PARTS / name
        write_json(folder / ATTEMPTS, of_task)
        for path in sorted(out.glob(f"{name}-*.tar")):
            if path.stem.removeprefix(f"{name}-").isdecimal():
                path.rename(folder / path.name)
    (out / MANIFEST).unlink(missing_ok=True)
