"""Pictures of the options of scenes and motions, one option or group of options a picture.

Each row has the same episodes under other settings, so that what differs from row to row is the option.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import yaml

from geoprior.config import load_config
from geoprior.hooks.manager import Plugins
from geoprior.options import Choice
from geoprior.synthesis.studio import Studio
from geoprior.view.canvas import below, beside, caption, framed, to_rgb

BASE = ["seed=6", "cameras.height=80", "cameras.width=80", "generate.renderer=solids"]
EPISODES = 8
CHART = (120, 560)
INK = np.array([240, 170, 60], np.uint8)


@dataclass(frozen=True)
class Option:
    """What one picture shows.

    Attributes:
        name: Of the picture.
        text: Of the page.
        settings: Of each row, as `--set` has them.
        moments: Which parts of the episodes are shown, 0 their first frame and 1 their last.
        motion: Of the episodes.
        speeds: Whether the rows are charts of the hand's speed in place of frames.
    """

    name: str
    text: str
    settings: Sequence[Sequence[str]]
    moments: Sequence[float] = (0.0,)
    motion: str = "pick"
    speeds: bool = False


def scene(options: object) -> str:
    """A setting of `generate.scene`."""
    return f"generate.scene={yaml.safe_dump(options, default_flow_style=True, width=10_000).strip()}"


def motion(name: str, **options: object) -> str:
    """A setting of `generate.motions`."""
    choice = yaml.safe_dump([{"name": name, **options}], default_flow_style=True, width=10_000).strip()
    return f"generate.motions={choice}"


FINGERS = {
    "hand": {"setback": [0.08, 0.08], "clearance": 0.1, "camera_up": [0.06, 0.06], "fingers": {}},
}
DOWN = {"hand": {"about": "middle", "offset": 0.12, "down": 1.0}}
SMALL = "generate.primitives=[{name: prism, width: [0.03, 0.06], height: [0.03, 0.06]}]"

OPTIONS = (
    Option(
        "start",
        "`scene.hand.aim`, `about`, `down`, `down_tilt`: where the hand is and points in the first frame. "
        "Above: as the paper has it, on the object. Then with a wide aim about the workspace's middle, and "
        "straight down as arms start.",
        [
            [scene({})],
            [scene({"hand": {"about": "middle", "offset": 0.12, "aim": 0.15}})],
            [scene(DOWN)],
        ],
    ),
    Option(
        "mount",
        "`scene.hand.camera_up`, `camera_right`, `camera_distance`, `camera_pitch`: a camera behind the "
        "hand's origin; one of robots, towards hand-up; and one that is also pitched by 20 degrees.",
        [
            [scene(DOWN)],
            [scene({"hand": {**DOWN["hand"], "camera_up": [0.04, 0.09], "camera_distance": [0.08, 0.13]}})],
            [scene({"hand": {**DOWN["hand"], "camera_up": [0.06, 0.06], "camera_pitch": [20, 20]}})],
        ],
    ),
    Option(
        "lens",
        "`scene.hand.lens`, `scene.third.lens`, `scene.third.target`: lenses that are off by up to 15 "
        "degrees, and a third-person camera that looks past the middle.",
        [
            [scene({})],
            [scene({"hand": {"lens": 15}, "third": {"lens": 15, "target": 0.1}})],
        ],
    ),
    Option(
        "fingers",
        "`scene.hand.setback` and `fingers`: the cube stands back behind the hand's origin, and two fingers "
        "reach from it to just past that origin. Both cameras see them; the hand camera sits 6 cm up here. "
        "First and last frames.",
        [
            [scene({}), SMALL],
            [scene(FINGERS), SMALL, motion("pick", from_above={})],
        ],
        (0.0, 1.0),
    ),
    Option(
        "arm",
        "`scene.arm`: a column, two links and a wrist, for the third-person camera alone.",
        [[scene({"third": {"azimuth": [-75, 75]}, "arm": {}})]],
        (0.0, 1.0),
    ),
    Option(
        "distractors",
        "`scene.distractors`: solids that lie farther out than objects do, clear of all that happens.",
        [[scene({"distractors": {"count": [3, 3]}})]],
    ),
    Option(
        "marker",
        "`scene.marker.size`, `outline`, `band`, `wall`: the goal as the paper has it, the object's "
        "silhouette; three times as large; a band around an empty middle; and a band with walls.",
        [
            [scene({"marker": marker}), SMALL]
            for marker in (
                {},
                {"size": [3, 3]},
                {"size": [3, 3], "outline": 1.0},
                {"size": [3, 3], "outline": 1.0, "wall": [0.02, 0.02]},
            )
        ],
        (0.0, 1.0),
        "place",
    ),
    Option(
        "pick-from-above",
        "`from_above` of `pick`: over the object, down with the fingers open on either side of it (`above`, "
        "`depth`, `tilt`), close (`closing`), and up with it (`lift`). Without a lift above, with one below.",
        [
            [scene(FINGERS), SMALL, motion("pick", from_above={})],
            [scene(FINGERS), SMALL, motion("pick", from_above={"lift": [0.12, 0.17], "tilt": 10})],
        ],
        (0.0, 0.33, 0.66, 1.0),
    ),
    Option(
        "place-from-above",
        "`from_above` of `place`: the same grasp; in the end the open hand rises (`retreat`).",
        [[scene(FINGERS), SMALL, motion("place", from_above={})]],
        (0.0, 0.33, 0.66, 1.0),
        "place",
    ),
    Option(
        "push-from-above",
        "`from_above` of `push`: over the point behind the object (`above`), down (`behind`, `height`), and "
        "straight to the marker with closed fingers (`closed`); the hand's up axis ahead above, `across` "
        "below.",
        [
            [scene(FINGERS), SMALL, motion("push", from_above={"across": 0.0})],
            [scene(FINGERS), SMALL, motion("push", from_above={"across": 1.0})],
        ],
        (0.0, 0.33, 0.66, 1.0),
        "push",
    ),
    Option(
        "speed",
        "`generate.seconds` as a range, and `ease` and `pace` of the motions: the hand's speed from step to "
        "step in eight episodes. Above, the paper's straight approach for 10 s; then from above for 4.5 to "
        "8 s with `ease` 0 and no `pace`; then with `ease` 1 and `pace` 0.3. The upper edge is 40 mm a step.",
        [
            [scene({})],
            [
                "generate.seconds=[4.5,8]",
                motion("pick", ease=[0, 0], from_above={"pace": 0, "lift": [0.1, 0.1]}),
            ],
            ["generate.seconds=[4.5,8]", motion("pick", ease=[1, 1], from_above={"lift": [0.1, 0.1]})],
        ],
        speeds=True,
    ),
)


def option_picture(option: Option, found: Plugins) -> np.ndarray:
    """The picture of an option."""
    rows = [_row(option, settings, found) for settings in option.settings]
    return framed(below(rows, 10))


def _row(option: Option, settings: Sequence[str], found: Plugins) -> np.ndarray:
    config = load_config("lite", [*BASE, *settings], found)
    studio = Studio(config.generate, config.cameras, config.seed)
    choice = next(each for each in config.generate.motions if each.name == option.motion)
    if option.speeds:
        return _chart([_speeds(studio, choice, index) for index in range(EPISODES)])
    shown = EPISODES // len(option.moments) or 1
    return beside(
        [_frames(studio, choice, index, moment) for index in range(shown) for moment in option.moments]
    )


def _frames(studio: Studio, choice: Choice, index: int, moment: float) -> np.ndarray:
    """What both cameras see at a moment, one below the other."""
    episode = studio.episode(choice, index)
    step = round(moment * (episode.header.steps - 1))
    return below([to_rgb(frames[step]) for frames in episode.images.values()])


def _speeds(studio: Studio, choice: Choice, index: int) -> np.ndarray:
    """(N - 1,) metres from step to step."""
    way = studio.stage(choice, index).trajectory.hand.transforms_hand_to_world[:, :3, 3]
    return np.linalg.norm(np.diff(way, axis=0), axis=1)


def _chart(series: Sequence[np.ndarray], highest: float = 0.04) -> np.ndarray:
    """Lines of speeds over time, one beside the other."""
    height, width = CHART[0], CHART[1] // len(series)
    panels = []
    for values in series:
        panel = np.full((height, width, 3), 20, np.uint8)
        columns = np.linspace(0, width - 1, len(values)).round().astype(int)
        rows = ((1.0 - np.clip(values / highest, 0.0, 1.0)) * (height - 1)).round().astype(int)
        for column in range(width):
            at = np.interp(column, columns, rows)
            panel[round(at) :, column] = INK // 3
            panel[round(at), column] = INK
        panels.append(below([panel, caption([f"{(len(values) + 1) / 10:.1f} s"], width)]))
    return beside(panels)
