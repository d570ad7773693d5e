"""The stages in order: fingerprint each, skip what is done, go on with what was begun.

A stage reads files and writes files under the paths that it owns. Its fingerprint is a hash of its part of
the config and of what it reads; its record in ``stages/`` says whether those outputs are whole.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from geoprior import StageEvent, provenance
from geoprior.config import RunConfig, plugins_named
from geoprior.errors import DataError
from geoprior.files import is_temporary, sha256_file, sha256_json, write_json
from geoprior.hooks.manager import Plugins
from geoprior.run_folder import RUN_FILE, Record, RunFolder, clear, drop, refuse_links, sweep
from geoprior.stages import STAGES, Stage, Workplace


def run_stages(folder: RunFolder, names: Sequence[str], plugins: Plugins, say: Callable[[str], None]) -> None:
    """Run the named stages in the order of the data's way, each only if its outputs are not there.

    Raises:
        GeopriorError: A stage failed; what it has finished stays and the same command goes on from it.
    """
    for stage in STAGES:
        if stage.name in names:
            stage.outside(folder.config)  # what is missing is said before hours of work and not after
    for stage in STAGES:
        if stage.name in names:
            _run_stage(folder, stage, plugins, say)
    _write_run_file(folder, plugins)
    _disband()


def follow_stages(config: RunConfig, path: Path, names: Sequence[str], plugins: Plugins) -> None:
    """Take part in the named stages as a process of torchrun that is not the first: train, and write nothing.

    Raises:
        GeopriorError: A training failed; it did so in all processes.
    """
    for stage in STAGES:
        if stage.name in names and stage.together and _all_run(run=True):
            stage.run(config, Workplace(path, plugins))
    _disband()


def _all_run(*, run: bool) -> bool:
    """What the first of torchrun's processes says of a stage. Alone, nothing is imported."""
    if not is_one_of_several():
        return run
    from geoprior.training.team import team

    return bool(team().agree(lambda: run))


def _disband() -> None:
    if is_one_of_several():
        from geoprior.training.team import disband

        disband()


def is_one_of_several() -> bool:
    """Whether torchrun started this process as one of several."""
    return int(os.environ.get("WORLD_SIZE", "1")) > 1


def is_follower() -> bool:
    """Whether torchrun started this process and it is not the first one."""
    return is_one_of_several() and os.environ.get("RANK") != "0"


def _run_stage(folder: RunFolder, stage: Stage, plugins: Plugins, say: Callable[[str], None]) -> None:
    begun = _begun_record(folder, stage, plugins)
    old = folder.record(stage.name)
    known = old if old is not None and old.fingerprint == begun.fingerprint else None
    lost = folder.lost(known, stage) if known else []
    if known and known.status == "done" and not lost:
        say(f"{stage.name}: done before, skipped")
        if stage.together:
            _all_run(run=False)
        return
    refuse_links(folder, stage)
    sweep(folder, stage)
    if lost:
        say(f"{stage.name}: {_some(lost)} missing or cut off, made again")
        drop(folder, stage, lost)
    elif known:
        say(f"{stage.name}: goes on")
    elif old is not None:
        say(f"{stage.name}: its inputs have changed, runs again")
        clear(folder, stage)
    folder.write_record(begun)
    if stage.together:
        _all_run(run=True)
    done = _execute(folder, stage, begun, plugins)
    folder.write_record(done)
    _write_run_file(folder, plugins)
    plugins.hook.geoprior_after_stage(event=_event(folder, done))


def _execute(folder: RunFolder, stage: Stage, begun: Record, plugins: Plugins) -> Record:
    plugins.hook.geoprior_before_stage(event=_event(folder, begun))
    clock = time.monotonic()
    try:
        result = stage.run(folder.config, Workplace(folder.path, plugins))
    except BaseException as error:
        seconds = time.monotonic() - clock
        plugins.hook.geoprior_stage_failed(event=_event(folder, begun, seconds, str(error) or "interrupted"))
        raise
    seconds = time.monotonic() - clock
    outputs = _outputs_on_disk(folder.path, stage)
    return Record(
        **{
            **vars(begun),
            "status": "done",
            "outputs": outputs,
            "result": result,
            "seconds": round(seconds, 3),
            "made_by": _maker(plugins),
        }
    )


def _begun_record(folder: RunFolder, stage: Stage, plugins: Plugins) -> Record:
    part = stage.config(folder.config)
    inputs = {name: _input_digest(folder, stage, name) for name in stage.inputs}
    inputs |= stage.outside(folder.config)
    content = {
        "stage": stage.name,
        "revision": stage.revision,
        "config": part,
        "plugins": plugins_named(part, plugins),
        "inputs": inputs,
    }
    return Record(
        stage=stage.name,
        status="begun",
        fingerprint=sha256_json(content),
        config=part,
        inputs=inputs,
        outputs={},
        result={},
        seconds=0.0,
    )


def _input_digest(folder: RunFolder, stage: Stage, name: str) -> str:
    record = folder.record(name)
    if record is None or record.status != "done":
        raise DataError(
            f"{folder.path}: {stage.name} reads what {name} writes, and {name} is not done here",
            f"geoprior {name} --out {folder.path}",
        )
    maker = next(each for each in STAGES if each.name == name)
    if lost := folder.lost(record, maker):
        raise DataError(
            f"{folder.path}: outputs of {name} are missing or cut off: {_some(lost)}",
            f"geoprior {name} --out {folder.path}",
        )
    return record.digest(maker)


def _some(names: Sequence[str]) -> str:
    return names[0] + (f" and {len(names) - 1} more" if len(names) > 1 else "")


def _outputs_on_disk(root: Path, stage: Stage) -> dict[str, dict[str, Any]]:
    files: list[Path] = []
    for output in stage.outputs:
        path = root / output
        files += [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return {
        str(file.relative_to(root)): {"bytes": file.stat().st_size, "sha256": sha256_file(file)}
        for file in sorted(files)
        if not is_temporary(file)
    }


def _write_run_file(folder: RunFolder, plugins: Plugins) -> None:
    records = {stage.name: folder.record(stage.name) for stage in STAGES}
    stages = {
        name: {
            "fingerprint": record.fingerprint,
            "seconds": record.seconds,
            "result": record.result,
            "made_by": record.made_by,
        }
        for name, record in records.items()
        if record is not None and record.status == "done"
    }
    content = {**_maker(plugins), "seed": folder.config.seed, "stages": stages}
    write_json(folder.path / RUN_FILE, content)


def _maker(plugins: Plugins) -> dict[str, Any]:
    return {
        "versions": provenance.versions(),
        "plugins": provenance.plugins_in_use(plugins),
        "machine": provenance.machine(),
    }


def _event(folder: RunFolder, record: Record, seconds: float | None = None, error: str = "") -> StageEvent:
    return StageEvent(
        record.stage, folder.path, record.fingerprint, record.seconds if seconds is None else seconds, error
    )


def interrupt_on_termination() -> None:
    """Let SIGTERM end a run as Ctrl-C does: with what is finished kept and a clear last word."""
    signal.signal(signal.SIGTERM, _raise_interrupt)


def _raise_interrupt(*_: object) -> None:
    raise KeyboardInterrupt
