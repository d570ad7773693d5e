"""A run's worth of material for the report: simulated trials, small pictures, films and logs."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from geoprior.report.report import Media
from geoprior.study.results import TrialRecord, summarise

RATES = {
    "prior": {256: 0.57, 512: 0.44, 768: 0.53, 1024: 0.5},
    "scratch": {256: 0.05, 512: 0.09, 768: 0.43, 1024: 0.45},
}
REASONS = ("never reached the cube", "gripper closed on nothing", "dropped it on the way")


def trials(rates=RATES, *, training_seeds=(0,), states=30, robot="ur5e", seed=0):
    """Trials whose initial states differ in difficulty and are shared by all conditions."""
    rng = np.random.default_rng(seed)
    difficulty = rng.random(states)
    return [
        TrialRecord(
            task="pick",
            robot=robot,
            condition=condition,
            training_seed=training_seed,
            epoch=epoch,
            state_seed=1000 + state,
            success=(success := bool(0.5 * (difficulty[state] + rng.random()) < rate)),
            reason="" if success else str(rng.choice(REASONS, p=[0.5, 0.35, 0.15])),
            steps=50,
            seconds=1.0,
        )
        for condition, curve in rates.items()
        for epoch, rate in curve.items()
        for training_seed in training_seeds
        for state in range(states)
    ]


def results(*args, **kwargs):
    return summarise(trials(*args, **kwargs), seed=0).model_dump(mode="json")


def write_image(path, *, binary, rows=3, columns=8):
    """A contact sheet of discs on random places."""
    rng = np.random.default_rng(0)
    image = np.full((rows * 100, columns * 100, 3), 0 if binary else 190, np.uint8)
    for row in range(rows):
        for column in range(columns):
            centre = (column * 100 + int(rng.integers(25, 75)), row * 100 + int(rng.integers(25, 75)))
            cv2.circle(image, centre, 14, (255, 255, 255) if binary else (40, 60, 200), -1)
    image[::100] = image[:, ::100] = 90
    cv2.imwrite(str(path), image)
    return path


def write_film(path, *, frames=20, size=128):
    """A disc that crosses the frame."""
    film = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"VP80"), 10.0, (2 * size, size))
    assert film.isOpened()
    for frame in range(frames):
        image = np.full((size, 2 * size, 3), 200, np.uint8)
        cv2.circle(image, (10 + frame * 5, size // 2), 12, (30, 90, 160), -1)
        film.write(image)
    film.release()
    return path


def write_log(path, *, epochs, start, end, steps=400):
    """A noisy exponential from one loss to another."""
    rng = np.random.default_rng(len(path.parent.name))
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        for step in range(1, steps + 1):
            l1 = (end + (start - end) * np.exp(-5.0 * step / steps)) * np.exp(0.1 * rng.normal())
            line = {"step": step, "epoch": epochs * step / steps, "l1": l1, "kl": 0.1, "loss": l1 + 1.0}
            file.write(json.dumps(line) + "\n")
    return path


@dataclass(frozen=True)
class Material:
    media: list[Media]
    losses: dict[str, Path]
    run: dict
    config_text: str


def make_material(folder):
    """Write everything that the report shows into a folder."""
    media = [
        Media("synthetic", write_image(folder / "sheet.png", binary=True), "Synthetic <episodes>", "image"),
        Media("demonstrations", write_image(folder / "demos.png", binary=False), "Demonstrations", "image"),
    ]
    for condition in ("prior", "scratch"):
        for state in (1000, 1001):
            film = write_film(folder / f"{condition}-{state}.webm")
            outcome = "success" if condition == "prior" else REASONS[state % 2]
            caption = f"{condition}, 1,024 epochs, initial state {state}: {outcome}"
            media.append(Media("rollouts", film, caption, "film", condition))
    return Material(
        media=media,
        losses={
            "pretrain": write_log(folder / "pretrain" / "log.jsonl", epochs=2000, start=0.9, end=0.1),
            "finetune/prior-s0": write_log(folder / "ps0" / "log.jsonl", epochs=1024, start=0.3, end=0.07),
            "finetune/scratch-s0": write_log(folder / "s0" / "log.jsonl", epochs=1024, start=0.9, end=0.075),
        },
        run={
            "versions": {"geoprior": "0.1.0", "python": "3.11.2", "torch": "2.13.0", "mujoco": "3.8.1"},
            "machine": {
                "system": "Linux x86_64",
                "processor": "Example CPU @ 2.1 GHz",
                "cores": 2,
                "gl": "egl",
            },
            "plugins": [{"name": "torus", "package": "geoprior-torus", "version": "0.1"}],
            "seed": 0,
            "stages": {
                "generate": {"fingerprint": "a", "seconds": 11.2, "result": {"episodes": 600}},
                "pretrain": {"fingerprint": "b", "seconds": 131.0, "result": {"steps": 1250}},
                "demos": {"fingerprint": "c", "seconds": 9.1, "result": {"episodes": 20}},
                "finetune": {"fingerprint": "d", "seconds": 75.0, "result": {"trainings": 2}},
                "evaluate": {"fingerprint": "e", "seconds": 44.0, "result": {"trials": 240}},
            },
        },
        config_text="seed: 0\ncameras:\n  height: 96\n  width: 96\nnote: a <b> & c\n",
    )
