"""A tiny policy and a tiny data set, on disk and in memory."""

import numpy as np
import torch

from geoprior.episode import CameraHeader, Episode, EpisodeHeader
from geoprior.options import Choice
from geoprior.policies.checkpoint import CheckpointHeader
from geoprior.policies.normalise import Normaliser
from geoprior.shards.manifest import write_manifest
from geoprior.shards.writer import write_shard
from geoprior.sources.shards import ShardSource
from geoprior.training.config import TrainConfig
from geoprior.training.data import Batches, features_of, statistics_of
from geoprior.training.loop import Training
from geoprior.training.machine import Machine

SIZE = 32
TINY_ACT = Choice(
    name="act",
    options={
        "chunk": 4,
        "dim": 16,
        "heads": 2,
        "ffn": 16,
        "encoder_layers": 1,
        "vae_layers": 1,
        "latent": 4,
        "trunk_width": 8,
    },
)


def make_demonstration(index, *, steps=9, fps=10.0, cameras=("hand", "third"), channels=1, offset=0.0):
    """An episode whose hand goes straight to a target that both cameras see as a bright square."""
    rng = np.random.default_rng(index)
    target = rng.uniform(0.2, 0.8, size=2)
    way = np.linspace(0.0, 1.0, steps + 1)[:, None]
    pose = np.zeros((steps + 1, 8), np.float32)
    pose[:, :2] = way * target + offset
    pose[:, 6] = 1.0
    pose[-2:, 7] = 1.0
    images = {}
    for name in cameras:
        frames = np.zeros((steps, SIZE, SIZE, 3), np.uint8)
        row, column = (target * (SIZE - 8)).astype(int)
        frames[:, row : row + 8, column : column + 8] = 255
        images[name] = frames if channels == 3 else frames[..., 0]
    header = EpisodeHeader(
        key=f"pick-{index:06d}",
        source="synthetic",
        motion="pick",
        index=index,
        seed=0,
        fps=fps,
        steps=steps,
        hands=["hand"],
        cameras=[
            CameraHeader(
                name=name,
                height=SIZE,
                width=SIZE,
                channels=channels,
                intrinsics=np.eye(3).tolist(),
                mount="world",
                transform_camera_to_mount=np.eye(4).tolist(),
            )
            for name in sorted(cameras)
        ],
        generator="test",
    )
    return Episode(header, pose[:-1].copy(), pose[1:].copy(), images)


def write_demonstrations(folder, count=5, **options):
    """Shards and a manifest of so many episodes of growing length."""
    folder.mkdir(parents=True)
    episodes = [make_demonstration(index, steps=6 + index, **options) for index in range(count)]
    write_manifest(folder, [write_shard(folder / "shard-000000.tar", episodes)])
    return folder


class FakeStore:
    """Stands in for an `EpisodeStore`: the same episodes, in memory."""

    digest = "0" * 64
    image_size = (SIZE, SIZE)
    target_names = ()

    def __init__(self, episodes):
        self.episodes = episodes
        self.cameras = tuple(camera.name for camera in episodes[0].header.cameras)
        self.hands = tuple(episodes[0].header.hands)
        self.fps = episodes[0].header.fps

    def __len__(self):
        return len(self.episodes)

    def pose(self, i):
        return self.episodes[i].pose

    def action(self, i):
        return self.episodes[i].action

    def frames(self, i, camera, steps):
        return self.episodes[i].images[camera][list(steps)]


class LinearPolicy(torch.nn.Module):
    """The smallest policy that is random in training and uses everything: no ACT in sight."""

    trunk_prefixes = ("eye.",)

    def __init__(self, features):
        super().__init__()
        self.features = features
        self.eye = torch.nn.Conv2d(3, 2, 8, 8)
        self.head = torch.nn.Linear(features.pose_size, features.chunk * features.pose_size)
        self.mix = torch.nn.Linear(2 * len(features.cameras), features.chunk * features.pose_size)

    def act(self, observation):
        seen = self.eye(observation["images"].flatten(0, 1)).mean((2, 3))
        raw = self.head(observation["pose"]) + self.mix(seen.reshape(len(observation["pose"]), -1))
        return raw.view(-1, self.features.chunk, self.features.pose_size)

    def loss(self, batch):
        noise = 0.1 * torch.randn_like(batch["action"])
        error = (self.act(batch) + noise - batch["action"]).abs() * batch["valid"].unsqueeze(-1)
        l1 = error.sum() / (batch["valid"].sum() * self.features.pose_size)
        return l1, {"loss": l1.detach(), "l1": l1.detach()}

    def predict(self, observation):
        with torch.no_grad():
            return self.act(observation)


def make_training(store, folder, seed=0, **options):
    """A training of the linear policy."""
    options = {"epochs": 8, "batch_size": 3, "threads": 1, "precision": "fp32", "log_every": 1, **options}
    config = TrainConfig(**options)
    source = ShardSource(store)
    features = features_of(source, chunk=4)
    statistics = statistics_of(source)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        policy = LinearPolicy(features)
    return Training(
        run="test",
        folder=folder,
        config=config,
        policy=policy,
        batches=Batches(source, features, Normaliser(statistics), config, seed),
        episodes=len(store),
        seed=seed,
        machine=Machine("cpu", config.precision, 1),
        header=CheckpointHeader(Choice(name="linear"), features, 10.0, statistics, 0, 0, {}),
        fingerprint=f"{seed} {config.learning_rate}",
    )
