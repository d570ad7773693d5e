"""What a user may say about the synthetic scenes. Light: pydantic only.

Lengths are metres and angles degrees. The frame is the workspace's: origin at the floor's middle (up to
the drawn floor height), z up, +x away from where a robot's base would stand.
"""

from __future__ import annotations

from pydantic import Field

from geoprior.options import Choice, Options
from geoprior.scene.ranges import DegreeRange, DistanceRange, ElevationRange, HeightRange, LengthRange


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


class HandConfig(Options):
    """Each hand: a cube whose front face holds the hand's origin, and the camera behind it."""

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
    camera_distance: float = Field(
        0.1, ge=0.0, le=1.0, description="The camera sits this far behind the hand's origin, metres."
    )


class ThirdCameraConfig(Options):
    """Where the third-person camera stands, seen from the middle between object and hands."""

    distance: LengthRange = Field((0.6, 1.3), description="To the middle between object and hands, metres.")
    azimuth: DegreeRange = Field((-180.0, 180.0), description="About z, from +x, degrees.")
    elevation: ElevationRange = Field((20.0, 70.0), description="Above the horizontal, degrees.")


class MarkerConfig(Options):
    """The goal drawn on the floor by `place` and `push`."""

    density: float = Field(
        30_000.0, gt=0.0, le=1e8, description="Points that fall on a square metre of the object's surface."
    )
    distance: DistanceRange = Field((0.12, 0.25), description="From the object to the marker, metres.")


class SceneConfig(Options):
    """A floor, an object, the hands, and the camera that watches them; a motion may add further objects."""

    floor: FloorConfig = Field(default_factory=FloorConfig, description="The floor plane.")
    object: ObjectConfig = Field(default_factory=ObjectConfig, description="The object.")
    hand: HandConfig = Field(default_factory=HandConfig, description="The hands and their cameras.")
    third: ThirdCameraConfig = Field(
        default_factory=ThirdCameraConfig, description="The third-person camera."
    )
    marker: MarkerConfig = Field(default_factory=MarkerConfig, description="The marker, where there is one.")
    margin: float = Field(
        0.02,
        ge=0.0,
        lt=0.5,
        description="What must be in the first frames stays this far from their edges, in frame heights.",
    )
