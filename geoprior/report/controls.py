"""What the prior's gain is made of, in a table and in sentences for a newcomer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geoprior.report.words import MINUS, capitalised, percent, points, points_interval, subject
from geoprior.study.schema import Bounds

if TYPE_CHECKING:
    from geoprior.study.schema import GainShare, GroupResult


def sentences(group: GroupResult) -> list[str]:
    """What the controls say, one sentence each; none where there are no controls."""
    if not group.gain_shares:
        return []
    prior, *others = group.gain_shares
    gain = f"{points(prior.gain.difference)} points ({points_interval(prior.gain.interval)})"
    if prior.share is None:
        return [
            f"The gain of {subject(prior.condition)} over {prior.baseline} is not clearly above zero here: "
            f"{gain}. So nobody can say what it is made of; more initial states or training seeds may tell."
        ]
    begin = capitalised(f"{subject(prior.condition)} gains {gain} over {prior.baseline}.")
    return [begin, *(said for share in others for said in _sentences(share))]


def _sentences(share: GainShare) -> list[str]:
    assert share.share is not None
    told = f"{share_percent(share.share)} of it{_between(share.interval)}"
    if share.control == "statistics":
        return [
            f"{share.condition}, random weights with the prior's normalisation, has {told}: so much takes no "
            "training on generated data at all."
        ]
    if share.control == "blind":
        rest = f"{share_percent(1.0 - share.share)}{_between(_rest(share.interval))}"
        return [
            f"{share.condition}, a prior trained in the same way on black images, has {told}: so much comes "
            "from normalisation and from how hands move, learned without looking.",
            f"What is left, {rest}, is what the prior owes to the images that it was trained on.",
        ]
    return []


def _between(interval: Bounds | None) -> str:
    if interval is None:
        return ", with an uncertainty too large to state"
    return f" ({share_percent_interval(interval)})"


def _rest(interval: Bounds | None) -> Bounds | None:
    return None if interval is None else Bounds(low=1.0 - interval.high, high=1.0 - interval.low)


def share_percent(share: float) -> str:
    """``-0.125`` as ``−13 %``: shares may be below zero and above one."""
    text = percent(abs(share))
    return f"{MINUS}{text}" if share < 0.0 and text != percent(0.0) else text


def share_percent_interval(bounds: Bounds) -> str:
    """``−5 % to 40 %``."""
    return f"{share_percent(bounds.low)} to {share_percent(bounds.high)}"
