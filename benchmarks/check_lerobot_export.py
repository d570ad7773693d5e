"""Whether an exported policy says in LeRobot what it says in geoprior.

    python benchmarks/check_lerobot_export.py FOLDER...

It runs in an environment of LeRobot's own (0.4.4), without geoprior. LeRobot loads the folder with
nothing missing and nothing left over, its pipelines normalise the observations that the export carries, and
its actions are compared with those in the export. Exit code 1 when they differ.
"""

from __future__ import annotations

import argparse
from importlib.metadata import version
from pathlib import Path

import torch
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.factory import make_pre_post_processors
from safetensors.torch import load_file

GOAL = 1e-5
"""Largest difference of any number of an action, in its own unit."""


def difference(folder: Path) -> float:
    """Largest difference over the chunks, and over the first action that LeRobot would carry out."""
    check = load_file(folder / "geoprior_check.safetensors")
    expected = check.pop("action")
    policy = ACTPolicy.from_pretrained(folder, strict=True)
    before, after = make_pre_post_processors(policy.config, pretrained_path=str(folder))
    raw = {
        name: tensor.movedim(-1, 1) / 255.0 if tensor.dim() == 4 else tensor for name, tensor in check.items()
    }
    chunks = after(policy.predict_action_chunk(before(raw)))
    policy.reset()
    first = after(policy.select_action(before(raw)))
    gaps = [(chunks - expected).abs().max(), (first - expected[:, 0]).abs().max()]
    return torch.stack(gaps).max().item()


def main() -> None:
    """Check every folder and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    differences = {folder: difference(folder) for folder in parser.parse_args().folders}
    for folder, gap in differences.items():
        print(f"{folder}: largest difference {gap:.1e} (goal {GOAL:.0e}), LeRobot {version('lerobot')}")
    if not all(gap <= GOAL for gap in differences.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
