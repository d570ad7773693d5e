"""Pictures of the robots, tasks and looks that ship with geoprior; see make_task_gallery.py."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from itertools import islice

import numpy as np

from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import GROUP, plugins
from geoprior.options import Choice
from geoprior.sim.backend import choose_gl
from geoprior.sim.workers import PLAIN, Setup, environment
from geoprior.view.canvas import below, beside, caption, fit

choose_gl()

import mujoco  # noqa: E402 - reads MUJOCO_GL when imported

from geoprior.sim.environment import Environment  # noqa: E402 - imports mujoco
from geoprior.sim.judge import Judge  # noqa: E402
from geoprior.sim.views import VISUAL_GROUP  # noqa: E402
from geoprior.sim.worlds.tabletop import HAND_CAMERA, THIRD_CAMERA  # noqa: E402

RATE = 10
FILM_SIZE = 160
ON_EVERY_ARM = ("pick", "place", "push", "pile", "door")
FIRST_ARM = "ur5e"
STATES = {"door": 8, "close": 8}
USUAL_STATE = 3
"""Initial states in which both cameras see everything."""

LOOK_STATES = {"place": 5, "pile": 0, "door": 7}
DRAWING_TASK, DRAWING_STEP = "pile", 40
DRAWING_SIZES = (256, 64)
"""What people look at, and what the quickstart's policy sees."""

NOTABLE = 25
"""Of 255: a pixel whose colour differs by more is counted."""


def pictures() -> dict[str, Callable[[], np.ndarray]]:
    """What draws each picture, by its name."""
    return {
        **{
            f"task-{task}-{arm}": partial(strip, arm, task) for task in built_in("task") for arm in arms(task)
        },
        **{f"look-{look}": partial(look_strip, look) for look in built_in("look")},
        **{f"drawing-{arm}": partial(drawings, arm) for arm in built_in("robot")},
    }


def strip(arm: str, task: str) -> np.ndarray:
    """What both cameras see at the start, in the middle and at the end of a demonstration."""
    frames = demonstration(made(arm, task), STATES.get(task, USUAL_STATE))
    last = len(frames) - 1
    moments = {"start": 0, "middle": last // 2, "end": last}
    return beside([pair(frames[at], f"{arm}, {word}: {at / RATE:.1f} s") for word, at in moments.items()])


def demonstration(env: Environment, state: int) -> list[np.ndarray]:
    """Film frames of a scripted demonstration, one more than commands.

    Raises:
        SystemExit: It does not succeed.
    """
    env.reset(state)
    judge, verdict, frames = Judge(env), None, [env.film_frame(FILM_SIZE)]
    for command in env.expert(seed=0):
        env.step(command)
        frames.append(env.film_frame(FILM_SIZE))
        verdict = judge.look()
        if verdict:
            break
    if verdict != "":
        sys.exit(f"{env.task.name} on {env.robot.name}, state {state}: {verdict or 'not done'}; take another")
    return frames


def look_strip(look: str) -> np.ndarray:
    """A few initial states in a look."""
    parts = []
    for task, state in LOOK_STATES.items():
        env = made(FIRST_ARM, task, Choice(name=look))
        env.reset(state)
        parts.append(pair(env.film_frame(FILM_SIZE), f"{task}, state {state}"))
    return beside(parts)


def drawings(arm: str) -> np.ndarray:
    """The same state as MuJoCo draws it by default and as geoprior does, through both cameras."""
    env = made(arm, DRAWING_TASK)
    env.reset(USUAL_STATE)
    for command in islice(env.expert(seed=0), DRAWING_STEP):
        env.step(command)
    stock = task_model(env)
    rows = []
    for size in DRAWING_SIZES:
        light, default = env.eyes.draw(env._model, env._data, size, size), stock_frames(*stock, size)
        rows.append(beside([part for camera in default for part in compared(camera, default, light)]))
    return below(rows)


def compared(camera: str, default: dict[str, np.ndarray], light: dict[str, np.ndarray]) -> list[np.ndarray]:
    """One camera's frame in both drawings."""
    frames = default[camera], light[camera]
    off = np.abs(frames[0].astype(int) - frames[1]).max(axis=-1) > NOTABLE
    size = len(off)
    words = f"{camera} {size}x{size}, default", f"light; {off.mean():.1%} of pixels differ"
    return [
        captioned(fit(frame, max(DRAWING_SIZES)), each) for frame, each in zip(frames, words, strict=True)
    ]


def task_model(env: Environment) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The same state in a model with all triangles."""
    sim = env.task.make(env.robot, env.setting).sim
    model, data = sim.model._model, sim.data._data
    for name in ("qpos", "mocap_pos", "mocap_quat"):
        getattr(data, name)[:] = getattr(env._data, name)
    mujoco.mj_forward(model, data)
    return model, data


def stock_frames(model: mujoco.MjModel, data: mujoco.MjData, size: int) -> dict[str, np.ndarray]:
    """Frames of `mujoco.Renderer`, of what robosuite shows: no collision geometries and no sites."""
    option = mujoco.MjvOption()
    option.geomgroup[:], option.sitegroup[:] = 0, 0
    option.geomgroup[VISUAL_GROUP] = 1
    frames = {}
    with mujoco.Renderer(model, size, size) as renderer:
        for camera in (THIRD_CAMERA, HAND_CAMERA):
            renderer.update_scene(data, camera, option)
            frames[camera] = renderer.render()
    return frames


def pair(film: np.ndarray, words: str) -> np.ndarray:
    """A film frame, its views named."""
    third, hand = film[:, :FILM_SIZE], film[:, FILM_SIZE:]
    return beside([captioned(third, words), captioned(hand, "hand camera")])


def captioned(frame: np.ndarray, words: str) -> np.ndarray:
    """A frame under a line of text."""
    return below([caption([words], frame.shape[1]), frame], gap=0)


def made(arm: str, task: str, look: Choice = PLAIN) -> Environment:
    """This process's environment for an arm, a task and a look."""
    cameras = CamerasConfig(height=FILM_SIZE, width=FILM_SIZE)
    return environment(Setup(Choice(name=arm), Choice(name=task), cameras, look), RATE)


def built_in(kind: str) -> list[str]:
    """What geoprior itself registers of a kind."""
    found = plugins()
    return [name for name in found.names(kind) if found.plugin_of(kind, name).package == GROUP]


def arms(task: str) -> list[str]:
    """The arms on which a task is shown."""
    return built_in("robot") if task in ON_EVERY_ARM else [FIRST_ARM]
