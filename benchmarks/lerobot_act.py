"""LeRobot's ACT at work, for the comparisons in train_speed.py and train_curve.py, which start it.

It runs in an environment of LeRobot's own (0.4.4) and does not import geoprior. ACT is as it comes: its
sizes, its frozen batch norm, its AdamW and the clipping of its gradients; without pretrained weights, and
with chunks of 25.

    python lerobot_act.py serve
        times steps and predictions, as the lines on its standard input ask
    python lerobot_act.py learn FOLDER NAME STEPS THREADS
        trains on the batches in a folder, as FOLDER/NAME.json says, and goes on where it was stopped
    python lerobot_act.py first FOLDER NAME STEPS THREADS
        takes the first steps of the same, and prints the L1 loss of each as a list in JSON
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version
from itertools import islice
from pathlib import Path

import torch
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot_parity import build
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

CAMERAS = ("hand", "third")
POSE_SIZE, CHUNK, SIZE, CLIP = 8, 25, 96, 10.0
MEAN = torch.tensor([0.485, 0.456, 0.406])[:, None, None]
STD = torch.tensor([0.229, 0.224, 0.225])[:, None, None]
SAVE_EVERY, JUDGE_EVERY = 100, 250


def build_policy(dropout: float = 0.1) -> ACTPolicy:
    """A policy with random weights, in training mode."""
    sizes = {"cameras": CAMERAS, "image_size": (SIZE, SIZE), "pose_size": POSE_SIZE}
    return build({"config": {"chunk_size": CHUNK}, **sizes}, dropout=dropout)


def make_optimizer(policy: ACTPolicy) -> torch.optim.Optimizer:
    """As LeRobot's own preset for ACT makes it."""
    return policy.config.get_optimizer_preset().build(policy.get_optim_params())


def take_step(policy: ACTPolicy, optimizer: torch.optim.Optimizer, batch: dict[str, Tensor]) -> float:
    """One step of LeRobot's training loop; returns the L1 loss."""
    loss, parts = policy.forward(batch)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(policy.parameters(), CLIP)
    optimizer.step()
    optimizer.zero_grad()
    return parts["l1_loss"]


def random_batch(size: int) -> dict[str, Tensor]:
    """Numbers as large as normalised ones."""
    batch = {f"observation.images.{camera}": torch.randn(size, 3, SIZE, SIZE) for camera in CAMERAS}
    batch |= {
        "observation.state": torch.randn(size, POSE_SIZE),
        "action": torch.randn(size, CHUNK, POSE_SIZE),
    }
    return batch | {"action_is_pad": torch.zeros(size, CHUNK, dtype=torch.bool)}


def serve() -> None:
    """Answer lines such as ``train 8 5`` with the seconds of five steps at a batch of 8, as JSON."""
    policy = build_policy()
    optimizer = make_optimizer(policy)
    print(json.dumps({package: version(package) for package in ("lerobot", "torch")}), flush=True)
    for line in sys.stdin:
        kind, size, count = line.split()
        print(json.dumps(list(times(policy, optimizer, kind, int(size), int(count)))), flush=True)


def times(
    policy: ACTPolicy, optimizer: torch.optim.Optimizer, kind: str, size: int, count: int
) -> Iterator[float]:
    """Seconds of so many steps or predictions, one after the other."""
    batch = random_batch(size)
    policy.train(kind == "train")
    for _ in range(count):
        begun = time.perf_counter()
        if kind == "train":
            take_step(policy, optimizer, batch)
        else:
            policy.predict_action_chunk(batch)
        yield time.perf_counter() - begun


def batches(path: Path, first: int, size: int) -> Iterator[dict[str, Tensor]]:
    """The recorded batches from number ``first`` on."""
    with safe_open(path, "pt") as file:
        count = file.get_slice("pose").get_shape()[0]
        for begin in range(first * size, count, size):
            rows = {name: file.get_slice(name)[begin : begin + size] for name in file.keys()}  # noqa: SIM118
            frames = (rows["frames"][:, :, None].float() - MEAN) / STD
            images = {f"observation.images.{camera}": frames[:, n] for n, camera in enumerate(CAMERAS)}
            yield {
                **images,
                "observation.state": rows["pose"],
                "action": rows["action"],
                "action_is_pad": ~rows["valid"].bool(),
            }


def held_out_l1(policy: ACTPolicy, path: Path) -> float:
    """Mean error of the deployed policy over valid actions, normalised."""
    policy.eval()
    total, terms = 0.0, 0
    for batch in batches(path, 0, 32):
        valid = ~batch["action_is_pad"]
        error = (policy.predict_action_chunk(batch) - batch["action"]).abs().sum(-1)
        total += float((error * valid).sum())
        terms += int(valid.sum()) * POSE_SIZE
    policy.train()
    return total / terms


def begin(folder: Path, name: str, threads: int) -> tuple[ACTPolicy, list[int]]:
    """The policy with the first weights of all, kept for the other side, and the seeds of the steps.

    ``NAME.json`` has the probability of dropout, the seed of every step's randomness, and what the first
    weights are multiplied with.
    """
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    asked = json.loads((folder / f"{name}.json").read_text())
    policy = build_policy(asked["dropout"])
    initial = folder / "lerobot_initial.safetensors"
    if not initial.exists():
        save_file(policy.state_dict(), initial)
    policy.load_state_dict({name: asked["nudge"] * tensor for name, tensor in load_file(initial).items()})
    return policy, asked["seeds"]


def first(folder: Path, name: str, steps: int, threads: int) -> None:
    """Print the L1 losses of the first steps."""
    policy, seeds = begin(folder, name, threads)
    optimizer = make_optimizer(policy)
    losses = []
    for seed, batch in zip(seeds[:steps], batches(folder / "train.safetensors", 0, 8), strict=False):
        torch.manual_seed(seed)
        losses.append(take_step(policy, optimizer, batch))
    print(json.dumps(losses))


def learn(folder: Path, name: str, steps: int, threads: int) -> None:
    """Train for so many steps."""
    policy, seeds = begin(folder, name, threads)
    optimizer = make_optimizer(policy)
    state, result = folder / f"{name}_state.safetensors", folder / f"{name}_curve.json"
    curve = json.loads(result.read_text())["curve"] if result.exists() else []
    done = resume(policy, optimizer, state)
    rest = islice(batches(folder / "train.safetensors", done, 8), steps - done)
    for step, batch in enumerate(rest, start=done + 1):
        torch.manual_seed(seeds[step - 1])
        l1 = take_step(policy, optimizer, batch)
        if step % JUDGE_EVERY == 0:
            curve = [row for row in curve if row["step"] < step]
            curve.append(
                {"step": step, "l1": l1, "held_out_l1": held_out_l1(policy, folder / "held_out.safetensors")}
            )
            versions = {package: version(package) for package in ("lerobot", "torch")}
            result.write_text(json.dumps({"versions": versions, "curve": curve}))
            print(curve[-1], flush=True)
        if step % SAVE_EVERY == 0:
            save(policy, optimizer, step, state)


def save(policy: ACTPolicy, optimizer: torch.optim.Optimizer, step: int, path: Path) -> None:
    """Weights and the optimiser's state, as one file."""
    tensors = {f"policy.{name}": tensor for name, tensor in policy.state_dict().items()}
    for name, parameter in policy.named_parameters():
        for key, value in optimizer.state.get(parameter, {}).items():
            tensors[f"optimizer.{name}.{key}"] = value
    save_file(tensors, path.with_suffix(".part"), {"step": str(step)})
    path.with_suffix(".part").replace(path)


def resume(policy: ACTPolicy, optimizer: torch.optim.Optimizer, path: Path) -> int:
    """Restore what `save` wrote; returns the steps done."""
    if not path.exists():
        return 0
    with safe_open(path, "pt") as file:
        done = int(file.metadata()["step"])
    tensors = load_file(path)
    policy.load_state_dict(
        {k.removeprefix("policy."): v for k, v in tensors.items() if k.startswith("policy.")}
    )
    for name, parameter in policy.named_parameters():
        prefix = f"optimizer.{name}."
        found = {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
        if found:
            optimizer.state[parameter] = found
    return done


if __name__ == "__main__":
    if sys.argv[1] == "serve":
        serve()
    else:
        work = {"learn": learn, "first": first}[sys.argv[1]]
        work(Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))
