"""A linear probe: how well the object's place can be read from what the visual trunk makes of an image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch

from geoprior.policies.normalise import normalise_images
from geoprior.policies.predictor import stack_cameras
from geoprior.probe.ridge import cross_validated

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import nn

    from geoprior.policies.policy import Features
    from geoprior.probe.aim import Resets
    from geoprior.probe.vision import VisionProbe
    from geoprior.training.machine import Machine

    FloatArray = NDArray[np.float64]

MOST_ROWS = 1_200
"""Moments that are used, at most: the regression is solved in them."""
_BATCH = 48
_CM = 100.0


def probe_resets(policy: nn.Module, resets: Resets, features: Features) -> dict[str, float] | None:
    """Errors at the initial states of a simulation, on a policy that is on the CPU; see `errors_cm`.

    Returns:
        None where the policy gives no features of its trunk.
    """
    ask = getattr(policy.eval(), "trunk_features", None)
    if ask is None:
        return None
    parts = []
    for first in range(0, len(resets), _BATCH):
        frames = {name: images[first : first + _BATCH] for name, images in resets.images.items()}
        seen = normalise_images(torch.from_numpy(stack_cameras(frames, features.cameras)))
        parts.append(ask(seen).double().numpy())
    places = {name: resets.places[name] for name in features.cameras}
    return errors_cm(np.concatenate(parts), places, np.arange(len(resets)))


def probe_episodes(policy: nn.Module, probe: VisionProbe, machine: Machine) -> dict[str, float] | None:
    """The same on the moments of episodes whose object's place is known.

    Returns:
        None where the place is not known or the policy gives no features of its trunk.
    """
    known, ask = probe.episodes.object_places, getattr(policy, "trunk_features", None)
    if known is None or ask is None:
        return None
    rows = probe.rows
    parts = probe.each_batch(policy, machine, np.arange(len(rows)), lambda _, seen: ask(seen))
    times = rows.steps[:, 0].reshape(len(probe.episodes), -1)
    found = [known(place, steps) for place, steps in enumerate(times)]
    places = {name: np.concatenate([each[name] for each in found]) for name in probe.features.cameras}
    return errors_cm(np.concatenate(parts), places, rows.episodes)


def errors_cm(
    trunk: FloatArray, places: Mapping[str, FloatArray], episodes: NDArray[np.int64]
) -> dict[str, float]:
    """Mean distance between where the object is and where a ridge reads it, by camera, centimetres.

    The place is that across the camera's line of sight, which its image shows wherever it is mounted: right
    and down of the camera's frame. Every place is read by a regression that was fitted on other episodes, a
    fifth of them at a time.

    Args:
        trunk: (M, cameras, F) features.
        places: By camera, in the order of the features, (M, 2) metres.
        episodes: (M,) of which episode each moment is.
    """
    rows = _thinned(episodes)
    found = {}
    for camera, (name, wanted) in enumerate(places.items()):
        read = cross_validated(trunk[rows, camera], wanted[rows], episodes[rows])
        found[name] = float(_CM * np.linalg.norm(read - wanted[rows], axis=1).mean())
    return found


def _thinned(episodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows of as many whole episodes as `MOST_ROWS` allows, evenly spread."""
    names, sizes = np.unique(episodes, return_counts=True)
    most = max(2, int(MOST_ROWS // sizes.mean()))
    kept = names[np.linspace(0, len(names) - 1, min(most, len(names))).astype(np.int64)]
    return np.flatnonzero(np.isin(episodes, kept))
