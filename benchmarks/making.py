"""Make one data set and say what it took. A process of its own, so that nothing else is in its memory.

python -m benchmarks.making EPISODES HEIGHT WIDTH SECONDS EXECUTOR WATCH_MEMORY RENDERER
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.memory import PeakMemory
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate

SEED = 20_000


@dataclass(frozen=True)
class Made:
    """One data set as made.

    Attributes:
        seconds: Wall time from the call to the manifest.
        bytes: Of its shards.
        peak: Largest memory of the process and its workers, bytes; 0 if nobody looked.
    """

    seconds: float
    bytes: int
    peak: int


def paper_config(episodes: int, seconds: float = 10.0, renderer: str = "points") -> GenerateConfig:
    """The paper's data set with so many episodes in all, a third of each motion."""
    return GenerateConfig(
        fps=30.0,
        seconds=seconds,
        episodes=max(1, episodes // 3),
        episodes_per_shard=30,
        renderer=Choice(name=renderer),
    )


def make_apart(
    episodes: int,
    height: int,
    width: int,
    *,
    seconds: float = 10.0,
    executor: str = "local",
    watch_memory: bool = False,
    renderer: str = "points",
) -> Made:
    """Make a data set in a fresh process; its imports are not counted, the start of its workers is.

    Looking at the memory costs some time, so speed and memory are measured apart.
    """
    arguments = (episodes, height, width, seconds, executor, int(watch_memory), renderer)
    command = [sys.executable, "-m", __name__, *map(str, arguments)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return Made(**json.loads(done.stdout))


def make(
    episodes: int,
    height: int,
    width: int,
    seconds: float,
    executor: str,
    *,
    watch_memory: bool,
    renderer: str,
) -> Made:
    """Make a data set in a folder that is thrown away."""
    memory = PeakMemory()
    with tempfile.TemporaryDirectory() as folder, memory if watch_memory else nullcontext():
        began = time.perf_counter()
        manifest = generate(
            paper_config(episodes, seconds, renderer),
            CamerasConfig(height=height, width=width),
            seed=SEED,
            executor=plugins().build("executor", Choice(name=executor)),
            out=Path(folder),
        )
        took = time.perf_counter() - began
    return Made(took, manifest.bytes, memory.peak)


if __name__ == "__main__":
    sizes, (length, name, watched, drawn_by) = [int(number) for number in sys.argv[1:4]], sys.argv[4:]
    made = make(
        sizes[0], sizes[1], sizes[2], float(length), name, watch_memory=watched == "1", renderer=drawn_by
    )
    sys.stdout.write(json.dumps(asdict(made)))
