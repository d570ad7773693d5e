"""What a user may say about the synthetic scenes. Light: pydantic only.

Lengths are metres and angles degrees. The frame is the workspace's: origin at the floor's middle (up to
the drawn floor height), z up, +x away from where a robot's base would stand.
"""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from geoprior.options import Choice, Options
from geoprior.scene.ranges import (
    CountRange,
    DegreeRange,
    DistanceOrRange,
    DistanceRange,
    ElevationRange,
    FractionRange,
    HeightRange,
    LengthRange,
    OffsetRange,
    SlackRange,
)

_SHORTEST_FINGER = 0.01
"""Metres from the hand's cube to its origin."""


class FloorConfig(Options):
    """The floor plane: a square grid of points."""

    side: LengthRange = Field((0.6, 1.0), description="Side of the square, metres.")
    height: HeightRange = Field((-0.03, 0.03), description="z of the plane, metres.")
    spacing: LengthRange = Field((0.05, 0.08), description="Grid resolution: metres between points.")


class ObjectConfig(Options):
    """Where the object rests and how densely it is drawn."""

    reach: float = Field(
        0.15, ge=0.0, le=5.0, description="The object's centre lies within this of the origin in x and in y."
    )
    density: float = Field(
        15_000.0, gt=0.0, le=1e8, description="Points on a square metre of the object's surface."
    )


class OtherConfig(Options):
    """A further object of a motion's scenes: what it is, and where it rests beside the first one."""

    primitives: list[Choice] = Field(
        default=[], description="Solids, each as likely; none named: those of the data set."
    )
    distance: LengthRange = Field((0.12, 0.25), description="From the first object's centre, metres.")
    gap: float = Field(
        0.03,
        ge=0.0,
        le=1.0,
        description="Least distance, seen from above, of the circles around any two objects, metres.",
    )


class FingersConfig(Options):
    """The fingers that both cameras see; see `geoprior.scene.fingers`."""

    opening: LengthRange = Field((0.085, 0.11), description="Between the open fingers, metres.")
    thickness: LengthRange = Field((0.007, 0.02), description="Of a finger, along the hand's right, metres.")
    width: LengthRange = Field((0.018, 0.032), description="Of a finger, along the hand's up, metres.")
    past: DistanceRange = Field(
        (0.005, 0.02), description="The fingers reach this far past the hand's origin, metres."
    )
    points: int = Field(5, ge=2, le=100, description="Points along an edge of a finger.")


class HandConfig(Options):
    """Each hand: a cube whose front face holds the hand's origin, or lies behind it, and a camera."""

    later = frozenset(
        {"about", "down", "down_tilt", "setback", "camera_up", "camera_right", "camera_pitch", "lens"}
        | {"fingers"}
    )

    height: LengthRange = Field((0.15, 0.45), description="Start above the floor, metres.")
    clearance: float = Field(
        0.05, ge=0.0, le=1.0, description="The start is at least this far above the object's top, metres."
    )
    offset: float = Field(
        0.2, ge=0.0, le=5.0, description="The start's largest horizontal distance to the object, metres."
    )
    aim: float = Field(
        0.05, ge=0.0, le=1.0, description="The hand points to within this of the object's centre, metres."
    )
    heading_spread: float = Field(
        60.0, ge=0.0, le=180.0, description="The start's heading lies within this of +x, degrees."
    )
    cube: LengthRange = Field((0.06, 0.08), description="Side of the cube, metres.")
    cube_points: int = Field(6, ge=2, le=200, description="Points along an edge of the cube.")
    camera_distance: DistanceOrRange = Field(
        0.1, description="The camera sits this far behind the hand's origin, metres: a number or a range."
    )
    about: Literal["object", "middle"] = Field(
        "object",
        description="What `offset` and `aim` are measured from: the object's centre, or the workspace's "
        "middle, so that a start says nothing of where the object lies.",
    )
    down: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Share of the starts that point straight down, as arms start. Of these the hand camera "
        "has the object's centre in view, of the others the whole object.",
    )
    down_tilt: float = Field(
        3.0, ge=0.0, le=45.0, description="Starts that point straight down lean by up to this, degrees."
    )
    setback: DistanceRange = Field(
        (0.0, 0.0),
        description="The cube's front face lies this far behind the hand's origin, the length of a gripper's "
        "fingers, metres.",
    )
    camera_up: OffsetRange = Field(
        (0.0, 0.0), description="The camera sits this far along the hand's up axis, metres."
    )
    camera_right: OffsetRange = Field(
        (0.0, 0.0), description="The camera sits this far along the hand's right axis, metres."
    )
    camera_pitch: DegreeRange = Field(
        (0.0, 0.0),
        description="The camera is turned this far from looking along forward, towards minus up, degrees.",
    )
    lens: float = Field(
        0.0,
        ge=0.0,
        le=30.0,
        description="cameras.hand.vertical_fov is off by up to this in the synthetic views, degrees.",
    )
    fingers: FingersConfig | None = Field(
        None, description="Two fingers that both cameras see; null draws none. They need a `setback`."
    )

    @model_validator(mode="after")
    def _refuse_fingers_without_room(self) -> Self:
        if self.fingers is not None and self.setback[0] < _SHORTEST_FINGER:
            raise ValueError(
                f"fingers need a cube that is set back by {_SHORTEST_FINGER} m at least, but setback begins "
                f"at {self.setback[0]}; raise setback or leave fingers out"
            )
        return self


class ThirdCameraConfig(Options):
    """Where the third-person camera stands, seen from the middle between object and hands."""

    later = frozenset({"target", "lens"})

    distance: LengthRange = Field((0.6, 1.3), description="To the middle between object and hands, metres.")
    azimuth: DegreeRange = Field((-180.0, 180.0), description="About z, from +x, degrees.")
    elevation: ElevationRange = Field((20.0, 70.0), description="Above the horizontal, degrees.")
    target: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="The camera looks to within this of that middle along each axis, metres.",
    )
    lens: float = Field(
        0.0,
        ge=0.0,
        le=30.0,
        description="cameras.third.vertical_fov is off by up to this in the synthetic views, degrees.",
    )


class MarkerConfig(Options):
    """The goal drawn on the floor by `place` and `push`."""

    later = frozenset({"size", "outline", "band", "wall"})

    density: float = Field(
        30_000.0, gt=0.0, le=1e8, description="Points that fall on a square metre of the object's surface."
    )
    distance: DistanceRange = Field((0.12, 0.25), description="From the object to the marker, metres.")
    size: LengthRange = Field(
        (1.0, 1.0),
        description="The marker is so many times as large as what the object covers of the floor.",
    )
    outline: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Share of the markers that are a band around an empty middle, as an enclosure is.",
    )
    band: FractionRange = Field((0.08, 0.25), description="Width of the band, as a share of the marker's.")
    wall: DistanceRange = Field(
        (0.0, 0.0), description="Height of the band where the object is set down from above, metres."
    )


class ArmConfig(Options):
    """An arm of boxes that the third-person camera sees; see `geoprior.scene.arm`."""

    distance: LengthRange = Field(
        (0.5, 0.7), description="From the workspace's middle to the arm's column, metres."
    )
    bearing: DegreeRange = Field(
        (-25.0, 25.0), description="Of the column about z, from -x, where robots stand, degrees."
    )
    shoulder: LengthRange = Field((0.25, 0.45), description="Height of the column, metres.")
    thickness: LengthRange = Field((0.06, 0.12), description="Of the links, metres.")
    wrist: LengthRange = Field(
        (0.05, 0.12), description="From the hand's cube to where the second link ends, metres."
    )
    upper: FractionRange = Field((0.45, 0.55), description="Share of the first link in the length of both.")
    slack: SlackRange = Field(
        (1.05, 1.35),
        description="Length of both links, as a multiple of the farthest that they reach in the episode.",
    )
    swivel: DegreeRange = Field((-50.0, 50.0), description="The elbow points aside from up by this, degrees.")
    points: int = Field(6, ge=2, le=100, description="Points along an edge of a box.")


class DistractorsConfig(Options):
    """Solids that have nothing to do with what happens; see `geoprior.scene.distractors`."""

    count: CountRange = Field((0, 2), description="How many; one that finds no room is left out.")
    primitives: list[Choice] = Field(
        default=[], description="Solids, each as likely; none named: those of the data set."
    )
    distance: LengthRange = Field(
        (0.26, 0.45),
        description="From the workspace's middle, metres: where no object lies, so that the one that is "
        "meant can be told.",
    )
    gap: float = Field(
        0.03,
        ge=0.0,
        le=1.0,
        description="Least distance, seen from above, to each other and to all that is or happens, metres.",
    )


class SceneConfig(Options):
    """A floor, an object, the hands, and the camera that watches them; a motion may add further objects."""

    later = frozenset({"arm", "distractors"})

    floor: FloorConfig = Field(default_factory=FloorConfig, description="The floor plane.")
    object: ObjectConfig = Field(default_factory=ObjectConfig, description="The object.")
    hand: HandConfig = Field(default_factory=HandConfig, description="The hands and their cameras.")
    third: ThirdCameraConfig = Field(
        default_factory=ThirdCameraConfig, description="The third-person camera."
    )
    marker: MarkerConfig = Field(default_factory=MarkerConfig, description="The marker, where there is one.")
    arm: ArmConfig | None = Field(None, description="An arm of boxes at each hand; null draws none.")
    distractors: DistractorsConfig | None = Field(
        None, description="Solids that lie about, out of the way; null draws none."
    )
    margin: float = Field(
        0.02,
        ge=0.0,
        lt=0.5,
        description="What must be in the first frames stays this far from their edges, in frame heights.",
    )
