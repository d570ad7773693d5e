"""The report stage: gather what the other stages left in a run folder, and write results and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

from geoprior.files import read_json, write_json
from geoprior.report.headline import headline
from geoprior.report.report import Media, write_report
from geoprior.shards.reader import EpisodeStore
from geoprior.study.results import TrialRecord, read_rollouts, summarise
from geoprior.study.shares import controls_of
from geoprior.view.sheet import store_sheet, write_sheet

if TYPE_CHECKING:
    from geoprior.training.config import ConditionConfig


def report_run(
    *,
    seed: int,
    synthetic: Path,
    demos: Path,
    checkpoints: Path,
    run: Path,
    results: Path,
    out: Path,
    conditions: Mapping[str, ConditionConfig] | None = None,
) -> Mapping[str, Any]:
    """Write ``results.json`` and the page.

    Args:
        seed: Root seed of the run.
        synthetic: Folder of the geometric data set.
        demos: Folder of the demonstrations.
        checkpoints: Folder of all trainings, each with a ``log.jsonl``.
        run: The run folder, with ``rollouts.jsonl``, ``config.yaml``, ``run.json`` and the films.
        results: Where the results go.
        out: The report's folder.
        conditions: How each condition began, which says what it tells of the prior's gain.

    Returns:
        The headline.

    Raises:
        DataError: What another stage wrote is missing or damaged.
    """
    trials = read_rollouts(run / "rollouts.jsonl")
    found = summarise(trials, seed=seed, controls=controls_of(conditions or {}))
    tree = found.model_dump(mode="json")
    write_json(results, tree)
    with TemporaryDirectory() as sheets:
        write_report(
            out=out,
            results=tree,
            config_text=(run / "config.yaml").read_text(encoding="utf-8"),
            run=read_json(run / "run.json"),
            media=[
                _sheet("synthetic", synthetic, Path(sheets)),
                _sheet("demonstrations", demos, Path(sheets)),
                *_films(run, trials),
            ],
            losses=dict(_logs(checkpoints)),
        )
    return {"headline": headline(found.groups[0])}


_KINDS = {
    "synthetic": "Generated: a plane, an object, a marker and a cube for the hand. No texture, no physics, "
    "no robot. ",
    "simulated": "Scripted demonstrations in simulation. ",
}


def _sheet(section: Literal["synthetic", "demonstrations"], shards: Path, folder: Path) -> Media:
    store = EpisodeStore(shards)
    path = folder / f"{section}.png"
    write_sheet(path, store_sheet(store))
    kind = _KINDS.get(store.header(0).source, "")
    return Media(section, path, f"{kind}{len(store)} episodes in all; a row each, both cameras.", "image")


def _films(run: Path, trials: Sequence[TrialRecord]) -> Iterator[Media]:
    for trial in trials:
        if trial.film:
            outcome = "success" if trial.success else trial.reason
            caption = (
                f"Initial state {trial.state_seed}, epoch {trial.epoch}: {outcome}, {trial.seconds:g} s. "
                "Left the third-person camera, right the hand's."
            )
            yield Media("rollouts", run / trial.film, caption, "film", trial.condition)


def _logs(checkpoints: Path) -> Iterator[tuple[str, Path]]:
    for log in sorted(checkpoints.rglob("log.jsonl")):
        yield str(log.parent.relative_to(checkpoints)), log
