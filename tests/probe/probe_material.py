"""Episodes whose object only the image shows, and policies that look or do not."""

import numpy as np
import torch

from geoprior.episode import CameraHeader, EpisodeHeader
from geoprior.policies.normalise import IMAGE_MEAN, IMAGE_STD, Normaliser
from geoprior.policies.policy import Features
from geoprior.probe.episodes import ProbeEpisodes
from geoprior.sources.source import Moments
from geoprior.training.data import features_of, statistics_of
from geoprior.training.machine import Machine

SIZE, CHUNK = 32, 4
HERE = Machine("cpu", "fp32", 1)


def square(target):
    """(SIZE, SIZE) a bright square of 4 x 4 whose middle tells a target in [0, 1]^2."""
    frame = np.zeros((SIZE, SIZE), np.uint8)
    row, column = np.round(np.asarray(target) * (SIZE - 4)).astype(int)
    frame[row : row + 4, column : column + 4] = 255
    return frame


def seen(frames):
    """(B, 2) targets that squares tell, from normalised frames (B, 3, SIZE, SIZE)."""
    light = frames[:, 0] * IMAGE_STD[0] + IMAGE_MEAN[0]
    weight = light.clamp_min(0.0) + 1e-9
    places = torch.arange(SIZE, dtype=torch.float32) - 1.5
    total = weight.sum(dim=(1, 2))
    row = (weight.sum(dim=2) * places).sum(dim=1) / total
    column = (weight.sum(dim=1) * places).sum(dim=1) / total
    return torch.stack([row, column], dim=1) / (SIZE - 4)


class SquareSource:
    """Episodes of one hand at rest in the middle that is told at once to go to a place, which a square shows.

    Every command of an episode is its target; the poses say nothing of it.
    """

    cameras, hands, image_size, fps, digest = ("hand", "third"), ("hand",), (SIZE, SIZE), 10.0, "0" * 64

    def __init__(self, count, steps=12, seed=0):
        rng = np.random.default_rng(seed)
        self.targets = np.round(rng.uniform(0.0, 1.0, (count, 2)) * (SIZE - 4)) / (SIZE - 4)
        self.poses, self.actions, self.asked = [], [], []
        for target in self.targets:
            pose = np.zeros((steps, 8), np.float32)
            pose[:, :3] = rng.normal(0.5, 0.1, (steps, 3))
            pose[:, 6] = 1.0
            action = pose.copy()
            action[:, :3] = [*target, 0.5]
            self.poses.append(pose)
            self.actions.append(action)

    def __len__(self):
        return len(self.poses)

    def read(self, numbers, steps):
        self.asked += list(zip(numbers.tolist(), steps[:, 0].tolist(), strict=True))
        frames = np.stack([square(self.targets[number]) for number in numbers])
        pairs = list(zip(numbers, steps, strict=True))
        return Moments(
            np.stack([self.poses[number][row[0]] for number, row in pairs]),
            np.stack([self.actions[number][row] for number, row in pairs]),
            {"hand": frames, "third": frames},
        )

    def close(self):
        pass


def square_episodes(count=12, motions=("pick", "push"), **options):
    """Episodes of a source, the motions in turn; their object is where the square is."""
    source = SquareSource(count, **options)

    def object_places(place, steps):
        return dict.fromkeys(source.cameras, np.tile(source.targets[place], (len(steps), 1)))

    names = [motions[slot % len(motions)] for slot in range(count)]
    return ProbeEpisodes(source, range(count), names, "squares", object_places)


def normaliser_of(episodes):
    return Normaliser(statistics_of(episodes.source))


def features(episodes):
    return features_of(episodes.source, CHUNK)


class Policy(torch.nn.Module):
    """Something that predicts and learns nothing."""

    trunk_prefixes = ()

    def __init__(self, normaliser):
        super().__init__()
        self.normaliser = normaliser
        self.modes = []

    def predict(self, observation):
        self.modes.append(self.training)
        raw = self.commands(observation)
        repeated = raw[:, None].expand(-1, CHUNK, -1).numpy()
        return torch.from_numpy(self.normaliser.normalise("action", repeated))

    def pose(self, observation):
        return torch.from_numpy(self.normaliser.denormalise("pose", observation["pose"].numpy()))


class Blind(Policy):
    """Repeats the pose, whatever is seen."""

    def commands(self, observation):
        return self.pose(observation)


class Looking(Policy):
    """Goes to where the third camera's square says."""

    def commands(self, observation):
        raw = self.pose(observation).clone()
        raw[:, :2], raw[:, 2] = seen(observation["images"][:, 1]), 0.5
        return raw

    def trunk_features(self, images):
        return torch.stack([seen(images[:, camera]) for camera in range(images.shape[1])], dim=1)


def header(key="pick-000000", motion="pick", steps=12, cameras=("hand", "third"), size=SIZE, hands=("hand",)):
    return EpisodeHeader(
        key=key,
        source="synthetic",
        motion=motion,
        index=0,
        seed=0,
        fps=10.0,
        steps=steps,
        hands=list(hands),
        cameras=[
            CameraHeader(
                name=name,
                height=size,
                width=size,
                channels=1,
                intrinsics=np.eye(3).tolist(),
                mount="world",
                transform_camera_to_mount=np.eye(4).tolist(),
            )
            for name in cameras
        ],
        generator="test",
    )


FEATURES = Features(("hand", "third"), (SIZE, SIZE), ("hand",), CHUNK)
