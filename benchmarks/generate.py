"""How fast the geometric data set is made, and how near that is to what the machine allows.

The floor is the projection kernel and the PNG encoder alone, on the same points, all cores at work: what is
left of a data set when scenes, motions, headers, hashes and files cost nothing. The peer is MuJoCo's own
renderer on a floor, a box and a cube. The same data set drawn as solids has a goal of its own.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.making import SEED, make_apart, paper_config
from benchmarks.metrics import Metric, at_least, at_most
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.render.points import PointsRenderer, axes_first, pixel_matrices
from geoprior.shards.binary_png import encode_members
from geoprior.synthesis.generate import ShardTask, plan_shards
from geoprior.synthesis.studio import Studio

if TYPE_CHECKING:
    from geoprior.hooks.types import Executor
    from geoprior.render.clouds import Shot

STEPS, VIEWS = 300, 2
PAPER_EPISODES = 600
SIZES = {(128, 128): 15.0, (480, 640): 150.0}
"""Goals in seconds for the paper's data set, by rows and columns of its frames."""
RATIO_GOAL = 1.4
SOLIDS_GOAL = 15_000.0
"""Images a second at 128 x 128, whole: staged, drawn, encoded and written."""
MEMORY_GOAL_MIB = 500.0
COUNTS = (60, 600, 6000)
PEER_FRAMES = 200
START_EPISODES = 60
"""Of 6 steps each, two shards: what is left is the start of the workers."""


def measure() -> Iterator[Metric]:
    """The paper's 600 episodes at both sizes, and memory and cost for 60 to 6,000 (some 5 minutes)."""
    warm_up()
    for (height, width), goal in SIZES.items():
        yield from _speed(height, width, PAPER_EPISODES, goal)
    yield from _solids(PAPER_EPISODES, SOLIDS_GOAL)
    yield from _constancy(COUNTS)


def measure_quickly() -> Iterator[Metric]:
    """A tenth of it."""
    warm_up()
    for height, width in SIZES:
        yield from _speed(height, width, PAPER_EPISODES // 10, None)
    yield from _solids(PAPER_EPISODES // 10, None)
    yield from _constancy(COUNTS[:1])


def warm_up() -> None:
    """Compile what is not compiled yet, and keep it on disk for those that follow."""
    for renderer in ("points", "solids"):
        make_apart(3, 128, 128, seconds=0.2, executor="serial", renderer=renderer)


def _speed(height: int, width: int, episodes: int, goal: float | None) -> Iterator[Metric]:
    size = f"{height}x{width}"
    images = episodes * STEPS * VIEWS
    start = make_apart(START_EPISODES, height, width, seconds=0.2).seconds
    made = make_apart(episodes, height, width)
    floor = floor_seconds(episodes, height, width)
    peer = mujoco_images_per_second(height, width)
    wall = f"{size}: {episodes} episodes, whole"
    yield at_most(wall, made.seconds, "s", goal) if goal else Metric(wall, made.seconds, "s")
    rate = f"{size}: images"
    yield (
        at_least(rate, images / made.seconds, "images/s", images / goal)
        if goal
        else Metric(rate, images / made.seconds, "images/s")
    )
    yield Metric(f"{size}: floor, kernel and encoder alone on all cores", floor, "s")
    yield at_most(f"{size}: ratio to the floor, whole", made.seconds / floor, "x", RATIO_GOAL)
    yield Metric(f"{size}: of it the start of the workers", start, "s")
    yield Metric(f"{size}: ratio to the floor without that start", (made.seconds - start) / floor, "x")
    yield Metric(f"{size}: shards", made.bytes / 2**20, "MiB")
    yield Metric(f"{size}: MuJoCo's renderer, one process", peer, "images/s")
    per_core = images / made.seconds / len(os.sched_getaffinity(0))
    yield Metric(f"{size}: ours over MuJoCo's, a core", per_core / peer, "x")


def _solids(episodes: int, goal: float | None) -> Iterator[Metric]:
    made = make_apart(episodes, 128, 128, renderer="solids")
    rate, name = episodes * STEPS * VIEWS / made.seconds, "128x128: images drawn as solids, whole"
    yield at_least(name, rate, "images/s", goal) if goal else Metric(name, rate, "images/s")
    yield Metric("128x128: shards drawn as solids", made.bytes / 2**20, "MiB")


def _constancy(counts: tuple[int, ...]) -> Iterator[Metric]:
    start = make_apart(START_EPISODES, 128, 128, seconds=0.2, watch_memory=True).seconds
    costs = {}
    for count in counts:
        made = make_apart(count, 128, 128, watch_memory=True)
        costs[count] = (made.seconds - start) / count
        memory = f"128x128: peak memory of all processes, {count} episodes"
        yield at_most(memory, made.peak / 2**20, "MiB", MEMORY_GOAL_MIB)
        yield Metric(f"128x128: an episode of {count}, start aside", 1e3 * costs[count], "ms")
    yield Metric("128x128: dearest over cheapest episode", max(costs.values()) / min(costs.values()), "x")


def floor_seconds(episodes: int, height: int, width: int) -> float:
    """Kernel and encoder alone on the points of the data set, all cores at work at the same time.

    Returns:
        Seconds in kernel and encoder, of all workers together, divided by the cores.
    """
    tasks = plan_shards(
        paper_config(episodes), CamerasConfig(height=height, width=width), SEED, Path("unused")
    )
    executor: Executor = plugins().build("executor", Choice(name="local"))
    busy = sum(seconds for _, seconds in executor.run(floor_of_shard, tasks))
    return busy / len(os.sched_getaffinity(0))


def floor_of_shard(task: ShardTask) -> float:
    """Seconds in kernel and encoder for the frames of one shard; staging them is not counted."""
    studio = Studio(task.config, task.cameras, task.seed)
    renderer = studio.renderer
    assert isinstance(renderer, PointsRenderer)
    floor_of_shot(renderer, studio.stage(*task.episodes[0]).shots["third"])  # loads the machine code
    total = 0.0
    for motion, index in task.episodes:
        for shot in studio.stage(motion, index).shots.values():
            total += floor_of_shot(renderer, shot)
    return total


def floor_of_shot(renderer: PointsRenderer, shot: Shot) -> float:
    """Seconds in kernel and encoder for one camera's frames of an episode."""
    drawn = [(pixel_matrices(cloud, shot.view), axes_first(cloud.points)) for cloud in shot.clouds]
    began = time.perf_counter()
    frames = renderer.draw_all(drawn, shot.view, shot.steps)
    encode_members(frames, shot.view.width, "floor.000000.png", 0)
    return time.perf_counter() - began


def mujoco_images_per_second(height: int, width: int, frames: int = PEER_FRAMES) -> float:
    """MuJoCo's own renderer, off screen, on a floor, a box and a cube, the camera moved for each frame."""
    from geoprior.sim.backend import choose_gl

    choose_gl()
    import mujoco

    model = mujoco.MjModel.from_xml_string(_SCENE.format(height=height, width=width))
    data = mujoco.MjData(model)
    with mujoco.Renderer(model, height, width) as renderer:
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance, camera.elevation = (0.0, 0.0, 0.05), 0.9, -35.0
        mujoco.mj_forward(model, data)
        began = time.perf_counter()
        for frame in range(frames + 10):
            if frame == 10:  # the first ones compile shaders
                began = time.perf_counter()
            camera.azimuth = frame
            renderer.update_scene(data, camera)
            renderer.render()
        return frames / (time.perf_counter() - began)


_SCENE = """
<mujoco>
  <visual><global offheight="{height}" offwidth="{width}"/></visual>
  <worldbody>
    <light pos="0 0 2"/>
    <geom type="plane" size="0.4 0.4 0.1"/>
    <geom type="box" size="0.03 0.02 0.04" pos="0.05 0.03 0.04" rgba="0.3 0.5 0.9 1"/>
    <geom type="box" size="0.035 0.035 0.035" pos="0 0 0.25" rgba="0.9 0.6 0.2 1"/>
  </worldbody>
</mujoco>
"""
