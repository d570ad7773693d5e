"""docs/tasks.md shows what ships and says what the code says; `python docs/make_task_gallery.py` makes it."""

import ast
import importlib
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from geoprior.hooks.manager import GROUP, plugins
from geoprior.sim import judge
from geoprior.sim.looks import distractors
from geoprior.sim.tasks.cable import small_cable
from geoprior.sim.tasks.cable import world as cable
from geoprior.sim.tasks.close import world as close
from geoprior.sim.tasks.door import world as door
from geoprior.sim.tasks.pile import world as pile
from geoprior.sim.tasks.place import world as place
from geoprior.sim.tasks.push import world as push
from geoprior.sim.tasks.stack import world as stack
from geoprior.sim.worlds import cube, goal, tabletop, vessel_world

ROOT = Path(__file__).parents[1]
DOCS, SIM = ROOT / "docs", ROOT / "geoprior" / "sim"
PAGE = (DOCS / "tasks.md").read_text(encoding="utf-8")
LINKS = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", PAGE)
PAPER_TASKS = ("pick", "place", "push", "pile", "door")

SAID = {
    "Robots": [
        tabletop.START_POSITION,
        tabletop.START_REACH,
        tabletop.THIRD_CAMERA_POSITION,
        tabletop.THIRD_CAMERA_TARGET,
        f"{np.degrees(tabletop.START_YAW):.0f} degrees",
    ],
    "How a trial is judged": [
        f"{np.degrees(np.arccos(vessel_world.LYING)):.0f} degrees",
        f"{tabletop.REST_SPEED} m ",
        f"{tabletop.REST_TURNING} rad ",
    ],
    "pick": [f"{2000 * cube.CUBE_HALF_SIZE:.0f} mm"],
    "place": [
        f"{2000 * place.INNER_HALF_SIZE:.0f} mm wide",
        f"{1000 * place.WALL_HEIGHT:.0f} mm high",
        f"{1000 * (place.INNER_HALF_SIZE - cube.CUBE_HALF_SIZE + 0.001):.0f} mm",
        f"{1000 * place.FLAT:.0f} mm",
        goal.MIDDLE,
    ],
    "push": [f"friction is {push.CUBE_FRICTION}"],
    "pile": [
        f"{1000 * pile.CAN_RADIUS:.0f} mm",
        f"{1000 * pile.ON_TOP:.0f} mm",
        f"{np.degrees(np.arccos(pile.UPRIGHT)):.0f} degrees",
        pile.MIDDLE,
    ],
    "door": [door.MIDDLE, f"{np.degrees(door.FACING):.0f} degrees", f"{door.CLEARANCE} m"],
    "stack": [f"{1000 * stack.ON_TOP:.0f} mm", f"{np.degrees(np.arccos(stack.FLAT)):.0f} degrees"],
    "close": [
        close.MIDDLE,
        f"{np.degrees(close.FACING):.0f} degrees",
        f"{close.OPEN} rad",
        f"{close.CLEARANCE} m",
    ],
    "cable": [
        cable.MIDDLE,
        cable.CABLE_REACH,
        f"{1000 * cable.ON_TABLE:.0f} mm",
        f"{1000 * cable.SPARE:.0f} mm",
        f"{small_cable.SEGMENTS} pieces of {1000 * small_cable.SEGMENT_LENGTH:.0f} mm",
    ],
    "distractors": [f"of {len(distractors.SHAPES)} solids", f"{1000 * distractors.CLEARANCE:.0f} mm"],
}
"""Numbers of the code that the prose repeats, by the heading under which it does."""


def built_in(kind):
    found = plugins()
    return [name for name in found.names(kind) if found.plugin_of(kind, name).package == GROUP]


def section(heading):
    """What stands under a heading, up to the next one of any depth, in one line."""
    found = re.search(rf"^##+ {re.escape(heading)}\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, f"docs/tasks.md has no heading {heading!r}"
    return " ".join(found[1].split())


def reasons_of_worlds():
    """What the methods `failure` of the worlds can return."""
    methods = [
        node
        for path in [*SIM.glob("worlds/*.py"), *SIM.glob("tasks/*/world.py")]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name == "failure"
    ]
    returns = [node for method in methods for node in ast.walk(method) if isinstance(node, ast.Return)]
    constants = [node for each in returns for node in ast.walk(each) if isinstance(node, ast.Constant)]
    return {node.value for node in constants if isinstance(node.value, str) and node.value}


def test_the_written_parts_are_what_the_command_would_write(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    # As --check does, without another process that would import the simulator again.
    assert importlib.import_module("task_page").written(PAGE) == PAGE


def test_every_task_is_shown_on_the_paper_s_arms_or_on_one():
    arms = built_in("robot")
    assert {"ur5e", "xarm7", "kinova3"} <= set(arms)
    for task in built_in("task"):
        for arm in arms if task in PAPER_TASKS else ["ur5e"]:
            assert f"(images/tasks/task-{task}-{arm}.png)" in section(task)


def test_every_look_and_every_drawing_is_shown():
    for look in built_in("look"):
        assert f"(images/tasks/look-{look}.png)" in section(look)
    for arm in built_in("robot"):
        assert f"(images/tasks/drawing-{arm}.png)" in section("What the pictures leave out")


def test_every_picture_that_the_page_links_is_there_and_no_other():
    folder = DOCS / "images" / "tasks"
    assert sorted(LINKS) == sorted(path.relative_to(DOCS).as_posix() for path in folder.iterdir())
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1_100_000
    for link in LINKS:
        with Image.open(DOCS / link) as image:
            assert np.asarray(image).std() > 20.0, f"{link} shows nothing"


@pytest.mark.parametrize("heading", SAID)
def test_the_prose_repeats_the_numbers_of_the_code(heading):
    text = section(heading)
    for said in SAID[heading]:
        words = said if isinstance(said, str) else f"({', '.join(f'{number:g}' for number in said)}) m"
        assert words in text, words


def test_every_reason_of_failure_is_explained():
    reasons = {judge.TIME_OUT, judge.UNSTABLE, judge.BAD_ACTION, judge.GAVE_UP, *reasons_of_worlds()}
    assert reasons >= {"dropped", "lifted"}
    explained = re.findall(r"\| `([^`]+)` \|", section("How a trial is judged"))
    assert set(explained) == reasons
