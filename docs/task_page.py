"""What docs/tasks.md takes from the code: the parts between its markers; see make_task_gallery.py."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from task_pictures import DRAWING_TASK, RATE, USUAL_STATE, arms, built_in

from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.culling import Boxes
from geoprior.sim.meshes import lighten_meshes
from geoprior.sim.setting import Setting
from geoprior.sim.views import VISUAL_GROUP
from geoprior.sim.workers import PLAIN
from geoprior.sim.worlds.tabletop import HAND_CAMERA, THIRD_CAMERA

PAGE = Path(__file__).parent / "tasks.md"
IMAGES = Path("images") / "tasks"
MARKED = re.compile(r"(<!-- written: (.*?) -->\n).*?(<!-- end -->)", re.DOTALL)


def written(page: str) -> str:
    """The page with every part as the code tells it now.

    Raises:
        SystemExit: A part has no place on the page, or a place no part.
    """
    texts, places = parts(), {name for _, name, _ in MARKED.findall(page)}
    if places != texts.keys():
        sys.exit(
            f"{PAGE}: add lines '<!-- written: NAME -->' and '<!-- end -->' for "
            f"{sorted(texts.keys() - places)}, and remove those of {sorted(places - texts.keys())}"
        )
    return MARKED.sub(lambda found: f"{found[1]}\n{texts[found[2]]}\n\n{found[3]}", page)


def parts() -> dict[str, str]:
    """The texts between markers, by name."""
    found = plugins()
    names = {kind: built_in(kind) for kind in ("robot", "task", "look")}
    models = [found.spec("robot", name).config for name in names["robot"]]
    return {
        "robots": summaries("robot"),
        "options of robots": "\n\n".join(options(model) for model in dict.fromkeys(models)),
        "tasks": task_table(),
        **{f"task {name}": task_part(name) for name in names["task"]},
        "looks": summaries("look"),
        **{f"look {name}": look_part(name) for name in names["look"]},
        "triangles": triangle_table(),
        "drawings": "\n\n".join(link(f"drawing-{arm}", arm) for arm in names["robot"]),
    }


def task_part(name: str) -> str:
    """Pictures and options of a task."""
    images = [link(f"task-{name}-{arm}", f"{name} on {arm}") for arm in arms(name)]
    return "\n\n".join([*images, options(plugins().spec("task", name).config)])


def look_part(name: str) -> str:
    """Picture and options of a look."""
    parts = link(f"look-{name}", name), options(plugins().spec("look", name).config)
    return "\n\n".join(part for part in parts if part)


def summaries(kind: str) -> str:
    """A table of what is registered."""
    return table([kind, ""], [[f"`{name}`", plugins().spec(kind, name).summary] for name in built_in(kind)])


def task_table() -> str:
    """Every task with its time limit and how long success must hold."""
    rows = []
    for name in built_in("task"):
        spec = plugins().spec("task", name)
        task = spec.factory(spec.config())
        rows.append([f"[`{name}`](#{name})", spec.summary, f"{task.seconds:g} s", f"{task.sustain:g} s"])
    return table(["task", "what must be achieved", "time limit", "success must hold for"], rows)


def options(model: Any) -> str:
    """A table of a config model's options, empty if it has none."""
    fields = model.model_json_schema().get("properties", {})
    rows = [
        [f"`{name}`", f"`{field['default']}`", allowed(field), field["description"]]
        for name, field in fields.items()
    ]
    return table(["option", "default", "allowed", "meaning"], rows) if rows else ""


def allowed(field: dict[str, Any]) -> str:
    """The values that a field of a JSON schema takes."""
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    low = f"{field['minimum']:g}" if "minimum" in field else f"more than {field['exclusiveMinimum']:g}"
    return f"{low} to {field['maximum']:g}"


def triangle_table() -> str:
    """How many triangles of meshes are drawn for each arm."""
    rows = []
    for arm in built_in("robot"):
        stock, light, third, hand = (f"{count:,}" for count in triangles(arm))
        rows.append([f"`{arm}`", stock, light, third, hand])
    return table(["robot", "full meshes", "merged", "of these, third camera", "hand camera"], rows, right=4)


def triangles(arm: str) -> Iterator[int]:
    """Of all visual meshes: as robosuite has them, merged, and left by culling for each camera."""
    found = plugins()
    setting = Setting(CamerasConfig(), RATE, found.build("look", PLAIN))
    world = found.build("task", Choice(name=DRAWING_TASK)).make(
        found.build("robot", Choice(name=arm)), setting
    )
    world.state_seed = USUAL_STATE
    world.reset()
    model, data = world.sim.model._model, world.sim.data._data
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    seen = np.flatnonzero(model.geom_group == VISUAL_GROUP)
    yield _count(model, seen)
    lighten_meshes(model)
    yield _count(model, seen)
    boxes = Boxes(model, VISUAL_GROUP)
    for camera in (THIRD_CAMERA, HAND_CAMERA):
        outside = boxes.outside(data, boxes.corners(data), model.camera(camera).id, 1.0)
        yield _count(model, seen[~outside])


def _count(model: Any, geoms: np.ndarray) -> int:
    meshes = model.geom_dataid[geoms]
    return int(model.mesh_facenum[meshes[meshes >= 0]].sum())


def table(head: list[str], rows: list[list[str]], right: int = 0) -> str:
    """A Markdown table whose last columns are aligned to the right."""
    rule = ["---"] * (len(head) - right) + ["---:"] * right
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, rule, *rows])


def link(image: str, words: str) -> str:
    """A picture in Markdown."""
    return f"![{words}]({(IMAGES / image).as_posix()}.png)"
