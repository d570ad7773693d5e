"""What each camera sees, and that the header's numbers say where it is."""

from __future__ import annotations

import numpy as np
import pytest

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.projection import View
from geoprior.geometry.se3 import apply, invert, transforms_of_poses
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.render import rig
from geoprior.render.clouds import Cloud, Shot
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import stage_episode, synthesise

CAMERAS = CamerasConfig(height=64, width=64)
CONFIG = GenerateConfig(fps=12, seconds=1.0)
MOTIONS = ("pick", "place", "push")


def draw(clouds, view, steps):
    return rig.render(plugins().build("renderer", Choice(name="points")), Shot(view, tuple(clouds), steps))


@pytest.mark.parametrize("motion", MOTIONS)
def test_frames_hold_exactly_what_each_camera_shall_see(motion):
    for index in range(4):
        take = stage_episode(CONFIG, CAMERAS, 2, Choice(name=motion), index)
        scene, trajectory = take.scene, take.trajectory
        renderer = plugins().build("renderer", Choice(name="points"))
        frames = {name: rig.render(renderer, shot) for name, shot in take.shots.items()}
        assert list(frames) == ["hand", "third"]
        for step in range(12):
            body = apply(trajectory.transforms_object_to_world[step], scene.object.points)
            cube = apply(trajectory.hand.transforms_hand_to_world[step], scene.hand.points)
            world = [scene.floor.points, body]
            if motion != "pick":
                world.append(trajectory.marker_points)
            camera = trajectory.hand.transforms_hand_to_world[step] @ scene.hand.transform_camera_to_hand
            riding = View(invert(camera), scene.hand.view.intrinsics, 64, 64)
            seen = draw([Cloud("body", np.vstack(world), np.eye(4))], riding, 1)[0]
            np.testing.assert_array_equal(frames["hand"][step], seen)
            seen = draw([Cloud("body", np.vstack([*world, cube]), np.eye(4))], scene.third_view, 1)[0]
            np.testing.assert_array_equal(frames["third"][step], seen)


@pytest.mark.parametrize("motion", MOTIONS)
def test_pose_and_header_alone_say_where_the_object_appears(motion):
    for index in range(60):
        choice = Choice(name=motion)
        take = stage_episode(CONFIG, CAMERAS, 3, choice, index)
        episode = synthesise(CONFIG, CAMERAS, 3, choice, index)
        assert (take.trajectory.marker_points is None) == (motion == "pick")
        for camera in episode.header.cameras:
            mount = np.eye(4)
            if camera.mount != "world":
                assert camera.mount == episode.header.hands[0]
                mount = transforms_of_poses(episode.pose[0])
            to_camera = np.linalg.inv(mount @ np.array(camera.transform_camera_to_mount))
            for points in (take.scene.object.points, take.scene.object.mesh.vertices):
                world = apply(take.scene.object.transform_object_to_world, points)
                seen = apply(to_camera, world) @ np.array(camera.intrinsics).T
                columns, rows = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
                assert seen[:, 2].min() > 0.05
                assert min(columns.min(), rows.min()) >= 0.0
                assert max(columns.max(), rows.max()) <= 63.0
            columns, rows = np.floor(columns).astype(int), np.floor(rows).astype(int)
            lit = episode.images[camera.name][0]
            world = apply(take.scene.object.transform_object_to_world, take.scene.object.points)
            seen = apply(to_camera, world) @ np.array(camera.intrinsics).T
            pixels = np.floor(seen[:, :2] / seen[:, 2:]).astype(int)
            # float32 poses move a point across a pixel's edge now and then
            assert np.mean(lit[pixels[:, 1], pixels[:, 0]] == 255) > 0.999
