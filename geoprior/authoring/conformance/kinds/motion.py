"""A motion: poses that any hand could take, from where the scene has the hands, by the generator alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from geoprior.authoring.conformance.check import Check, digest, refuse, require, require_array
from geoprior.authoring.conformance.material import scene
from geoprior.episode import POSE_SIZE
from geoprior.errors import ConfigError
from geoprior.geometry.se3 import apply
from geoprior.geometry.seeding import generator
from geoprior.hooks.types import MotionSpec
from geoprior.motions.trajectory import Trajectory, ways_of_objects
from geoprior.scene.scene import Scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

STEPS = 60
SCENES = range(14)
FARTHEST = 0.15
"""Metres that anything may move from one of `STEPS` to the next: less than a teleport."""
TOLERANCE = 1e-6


def _planned(spec: MotionSpec, number: int, steps: int = STEPS) -> tuple[Scene, Trajectory]:
    before = scene(number, spec)
    return before, spec.factory(spec.config()).plan(before, steps, generator(number, "conformance"))


def _plans(spec: MotionSpec) -> Iterator[tuple[str, Scene, Trajectory]]:
    for number in SCENES:
        yield f"motion {spec.name!r}, scene {number}", *_planned(spec, number)


def _ways(before: Scene, plan: Trajectory) -> dict[str, FloatArray]:
    """Of every hand and object, (N, 4, 4) to the world."""
    ways = {name: way.transforms_hand_to_world for name, way in plan.hands.items()}
    for name, transforms in ways_of_objects(before, plan).items():
        ways[name] = np.broadcast_to(transforms, (plan.steps, 4, 4))
    return ways


def has_every_step(spec: MotionSpec) -> None:
    """Every part of a trajectory has as many steps as were asked for, and all hands are there, in order."""
    for where, before, plan in _plans(spec):
        require(
            set(plan.others) <= set(before.others),
            f"{where}: moves {sorted(set(plan.others) - set(before.others))}, which its scene does not have",
            "name every further object in the spec's `others`",
        )
        require(
            tuple(plan.hands) == tuple(spec.hands),
            f"{where}: moves the hands {list(plan.hands)}, its spec says {list(spec.hands)}",
            "plan for every hand of `scene.hands`, and say in the spec which ones there are",
        )
        for name, way in plan.hands.items():
            require_array(way.transforms_hand_to_world, f"{where}, {name}", (STEPS, 4, 4), np.float64)
            gripper = require_array(way.gripper, f"{where}, gripper of {name}", (STEPS,), np.float64)
            require(
                set(gripper.tolist()) <= {0.0, 1.0},
                f"{where}: the gripper of {name} is neither 0 (open) nor 1 (closed)",
                "a gripper is a step, never interpolated",
            )
        for name, transforms in {"object": plan.transforms_object_to_world, **plan.others}.items():
            require_array(transforms, f"{where}, {name}", (STEPS, 4, 4), np.float64)
        require(
            len(plan.phases) == STEPS and all(isinstance(phase, str) for phase in plan.phases),
            f"{where}: {len(plan.phases)} phases for {STEPS} steps",
            "name the phase of every step",
        )


def frames_are_rotations(spec: MotionSpec) -> None:
    """Hands and object have right-handed orthonormal frames; hands are [right, up, forward]."""
    for where, before, plan in _plans(spec):
        for name, transforms in _ways(before, plan).items():
            rotation = transforms[:, :3, :3]
            error = np.abs(np.swapaxes(rotation, 1, 2) @ rotation - np.eye(3)).max()
            require(error < TOLERANCE, f"{where}: a frame of {name} is not orthonormal (by {error:.2g})")
            require(
                np.linalg.det(rotation).min() > 0.0,
                f"{where}: a frame of {name} is left-handed",
                "columns are [right, up, forward] with right = up x forward",
            )
            last_row = transforms[:, 3]
            require(np.array_equal(last_row, np.broadcast_to([0.0, 0.0, 0.0, 1.0], last_row.shape)),
                    f"{where}: the last row of a transform of {name} is not 0 0 0 1")  # fmt: skip


def begins_with_the_scene(spec: MotionSpec) -> None:
    """The first step is what the scene says."""
    for where, before, plan in _plans(spec):
        expected = {name: hand.transform_hand_to_world for name, hand in before.hands.items()}
        expected |= {name: thing.transform_object_to_world for name, thing in before.objects.items()}
        for name, transforms in _ways(before, plan).items():
            require(
                np.allclose(transforms[0], expected[name], atol=TOLERANCE),
                f"{where}: {name} is not where the scene has it at the first step",
                "begin at scene.hands[...].transform_hand_to_world and at the objects' own transforms",
            )


def nothing_jumps_or_sinks(spec: MotionSpec) -> None:
    """Hands and object move a little from step to step, and stay above the floor."""
    for where, before, plan in _plans(spec):
        for name, transforms in _ways(before, plan).items():
            moved = np.linalg.norm(np.diff(transforms[:, :3, 3], axis=0), axis=1)
            step = int(moved.argmax())
            require(
                moved[step] < FARTHEST,
                f"{where}: {name} jumps by {moved[step]:.3f} m after step {step}",
                "interpolate, as geoprior.geometry.interpolate does",
            )
        for name, transforms in _ways(before, plan).items():
            thing = before.objects.get(name)
            points = np.zeros((1, 3)) if thing is None else thing.mesh.vertices
            depth = before.floor.height - apply(transforms, points)[..., 2].min()
            require(depth < TOLERANCE, f"{where}: {name} is {depth:.4f} m below the floor")


def poses_are_continuous(spec: MotionSpec) -> None:
    """Pose vectors have unit quaternions that never turn by half a revolution in one step."""
    for where, _, plan in _plans(spec):
        poses = plan.pose()
        require_array(poses, f"{where}, pose", (STEPS, 8 * len(spec.hands)), np.float32)
        quaternions = poses.reshape(STEPS, -1, POSE_SIZE)[..., 3:7].astype(np.float64)
        dots = np.sum(quaternions[1:] * quaternions[:-1], axis=-1)
        require(
            (dots > 0.5).all(),
            f"{where}: a hand turns by more than 120 degrees after step {int(dots.min(axis=1).argmin())}",
            "turn by SLERP, as geoprior.geometry.interpolate.slerp does",
        )


def markers_lie_on_the_floor(spec: MotionSpec) -> None:
    """Where there is a marker, it is points on the floor."""
    for where, before, plan in _plans(spec):
        if plan.marker_points is None:
            continue
        points = require_array(plan.marker_points, f"{where}, marker", (None, 3), np.float64)
        require(
            np.allclose(points[:, 2], before.floor.height, atol=TOLERANCE),
            f"{where}: the marker is not on the floor",
            "geoprior.scene.marker.marker_points projects onto it",
        )


def only_its_generator_decides(spec: MotionSpec) -> None:
    """The same scene and seed give the same plan; another object of the motion makes no difference."""
    motion = spec.factory(spec.config())
    first = [digest(motion.plan(scene(n, spec), STEPS, generator(n, "conformance"))) for n in SCENES]
    for number in reversed(SCENES):
        require(
            digest(_planned(spec, number)[1]) == first[number],
            f"motion {spec.name!r}, scene {number}: plans differently the second time",
            "take every random number from the argument of `plan`, and keep nothing between calls",
        )


def leaves_the_scene_alone(spec: MotionSpec) -> None:
    """Planning does not change the scene."""
    for number in SCENES:
        before = digest(scene(number, spec))
        require(
            digest(_planned(spec, number)[0]) == before,
            f"motion {spec.name!r}, scene {number}: planning changed the scene",
            "copy an array before you write to it",
        )


def few_steps_are_planned_or_refused(spec: MotionSpec) -> None:
    """One step or two are planned, or refused with a ConfigError that says how many it needs."""
    for steps in range(1, 8):
        try:
            plan = _planned(spec, 0, steps)[1]
        except ConfigError:
            continue
        except Exception as error:  # noqa: BLE001 - a stranger's motion may raise anything
            refuse(
                f"motion {spec.name!r}: {steps} steps raise {type(error).__name__}: {error}",
                "raise geoprior.errors.ConfigError and say how many steps it needs",
            )
        require(
            plan.steps == steps,
            f"motion {spec.name!r}: plans {plan.steps} steps where {steps} were asked for",
        )


CHECKS = (
    Check("it plans every step of every hand", has_every_step),
    Check("its frames are right-handed rotations", frames_are_rotations),
    Check("it begins where the scene begins", begins_with_the_scene),
    Check("nothing jumps or sinks into the floor", nothing_jumps_or_sinks),
    Check("its poses are continuous", poses_are_continuous),
    Check("its marker lies on the floor", markers_lie_on_the_floor),
    Check("a seed decides the plan, and nothing else does", only_its_generator_decides),
    Check("it leaves the scene alone", leaves_the_scene_alone),
    Check("few steps are planned or refused", few_steps_are_planned_or_refused),
)
