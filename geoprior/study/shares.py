"""How much of the prior's gain each other condition has: controls tell what the gain is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.seeding import generator
from geoprior.study.paired import area_table, bounds, difference, rounded
from geoprior.study.schema import Control, GainShare
from geoprior.study.statistics import share_interval

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from geoprior.study.paired import Outcomes
    from geoprior.training.config import ConditionConfig

PRIOR = "prior"
"""The condition whose gain is shared out."""


def controls_of(conditions: Mapping[str, ConditionConfig]) -> dict[str, Control]:
    """What each condition of a config can tell of the prior's gain."""
    return {name: _control(condition) for name, condition in conditions.items()}


def _control(condition: ConditionConfig) -> Control:
    if condition.init == "blind-prior":
        return "blind"
    if condition.init == "scratch" and condition.statistics != "new":
        return "statistics"
    return "other"


def gain_shares(
    outcomes: Mapping[str, Outcomes],
    baseline: str,
    controls: Mapping[str, Control],
    *,
    seed: int,
    scene: Sequence[str],
) -> list[GainShare]:
    """The share of every condition but the baseline, the prior's first.

    Args:
        outcomes: By condition.
        baseline: What a gain is a gain over.
        controls: What conditions tell; those not named tell nothing in particular.
        seed: Root seed; names the resamples.
        scene: Robot, task and look; the same.

    Returns:
        Nothing where there is no baseline or no prior, or where no other condition has checkpoints at the
        epochs of both.
    """
    if not {baseline, PRIOR} <= outcomes.keys():
        return []
    others = [name for name in outcomes if name not in (baseline, PRIOR)]
    shares = [
        _share(name, outcomes, baseline, controls.get(name, "other"), seed, ("compare", *scene))
        for name in [PRIOR, *others]
    ]
    found = [share for share in shares if share is not None]
    return found if any(share.condition != PRIOR for share in found) else []


def _share(
    name: str,
    outcomes: Mapping[str, Outcomes],
    baseline: str,
    control: Control,
    seed: int,
    keys: tuple[str, ...],
) -> GainShare | None:
    epochs = sorted(outcomes[name].keys() & outcomes[PRIOR].keys() & outcomes[baseline].keys())
    if not epochs:
        return None
    areas = {each: area_table(outcomes[each], epochs) for each in (name, PRIOR, baseline)}
    gain, whole = (np.clip(areas[each] - areas[baseline], -1.0, 1.0) for each in (name, PRIOR))
    # The same resamples as the comparison's, so that equal epochs give equal intervals.
    paired = difference(gain, generator(seed, *keys, name, baseline, "area"))
    prior = difference(whole, generator(seed, *keys, PRIOR, baseline, "area"))
    clear = prior.interval.low > 0.0
    interval = share_interval(gain, whole, generator(seed, *keys, name, baseline, "share")) if clear else None
    return GainShare(
        condition=name,
        control=control,
        reference=PRIOR,
        baseline=baseline,
        area_under_curve=rounded(float(areas[name].mean())),
        gain=paired,
        share=rounded(float(gain.mean() / whole.mean())) if clear else None,
        interval=None if interval is None else bounds(interval),
    )
