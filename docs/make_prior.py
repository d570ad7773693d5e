"""Write the tables of docs/prior.md from benchmarks/results/*.json; the text around them stays.

python docs/make_prior.py            # writes them
python docs/make_prior.py --check    # ends with 1 if the page is not what the results say
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PAGE = ROOT / "docs" / "prior.md"
TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
Content = Mapping[str, Any]


def factors(content: Content) -> Iterator[str]:
    """One prior a line: does it see, and how far from the object does it aim without fine-tuning?"""
    yield "| prior | vision gain, pick | L1, all | UR5e pick | xArm7 place | Kinova3 push |"
    yield "| --- | ---: | ---: | ---: | ---: | ---: |"
    for name, found in content["measures"].items():
        everything, pick = found["motions"]["all"], found["motions"]["pick"]
        baseline = min(everything["still"], everything["pose_only"])
        gain = 100.0 * pick["vision_gain"] / pick["shuffled"]
        aims = [
            f"{aim['true_cm']:.1f} / {aim['shuffled_cm']:.1f}" if aim else "-"
            for aim in found["aims"].values()
        ]
        row = [name, f"{gain:.0f} %", f"{everything['true'] / baseline:.2f}", *aims]
        yield f"| {' | '.join(row)} |"
    yield ""
    yield "Vision gain: as a share of the L1 with shuffled images. L1: over the better baseline's."
    yield "The rest: aim error in cm without fine-tuning, with the right images / with another state's."


def study(outcome: Content) -> Iterator[str]:
    """Success of every condition at every checkpoint, and what it gains over the baseline."""
    for group in outcome["groups"]:
        conditions = group["conditions"]
        epochs = [checkpoint["epoch"] for checkpoint in conditions[0]["checkpoints"]]
        seeds, states = len(group["training_seeds"]), group["initial_states"]
        yield f"{group['task']} on {group['robot']}, {seeds} root seeds, {states} unseen initial states:"
        yield ""
        yield f"| from | {' | '.join(f'{epoch} epochs' for epoch in epochs)} | area | less scratch, 95 % |"
        yield f"| --- |{' ---: |' * (len(epochs) + 2)}"
        gains = {each["condition"]: each["area_under_curve"] for each in group["comparisons"]}
        for condition in conditions:
            rates = [f"{100.0 * checkpoint['rate']:.0f} %" for checkpoint in condition["checkpoints"]]
            gain = gains.get(condition["name"])
            told = _points(gain) if gain else ""
            row = [condition["name"], *rates, f"{100.0 * condition['area_under_curve']:.0f} %", told]
            yield f"| {' | '.join(row)} |"
        yield ""


def _points(gain: Content) -> str:
    low, high = gain["interval"]["low"], gain["interval"]["high"]
    return f"{100.0 * gain['difference']:.0f} points ({100.0 * low:.0f} to {100.0 * high:.0f})"


def quickstart(content: Content) -> Iterator[str]:
    """The quickstart over its root seeds."""
    yield from study(content["outcome"])


def arms(content: Content) -> Iterator[str]:
    """Every arm and task."""
    for outcome in content["outcome"].values():
        yield from study(outcome)


def measures(content: Content) -> Iterator[str]:
    """Rank correlations, and of how many checkpoints each is."""
    values = {row["metric"]: row["value"] for row in content["results"]}
    yield "| measure | rank correlation with success | checkpoints |"
    yield "| --- | ---: | ---: |"
    for name, value in values.items():
        if (count := values.get(f"{name}: of")) is not None:
            yield f"| {name} | {value:.2f} | {count:.0f} |"


TABLES: dict[str, tuple[str, Callable[[Content], Iterator[str]]]] = {
    "factors": ("prior_factors", factors),
    "quickstart": ("prior_over_seeds", quickstart),
    "arms": ("prior", arms),
    "priors": ("prior", factors),
    "measures": ("prior_measures", measures),
}
"""Of the page: the file of results, and what is written of it."""


def page() -> str:
    """The page with its tables as the results have them."""
    return TABLE.sub(_table, PAGE.read_text())


def _table(found: re.Match[str]) -> str:
    name, write = TABLES[found[2]]
    path = RESULTS / f"{name}.json"
    if not path.is_file():
        return f"{found[1]}Not measured yet.\n{found[3]}"
    content = json.loads(path.read_text())
    note = [content["note"], ""] if "note" in content else []
    lines = ["", *write(content), "", *note, f"    {content['command']}", ""]
    return found[1] + "\n".join(lines) + "\n" + found[3]


def main() -> None:
    """Write the page, or compare it."""
    wanted = page()
    if "--check" in sys.argv[1:]:
        sys.exit(0 if PAGE.read_text() == wanted else f"{PAGE}: run docs/make_prior.py")
    PAGE.write_text(wanted)
    print(PAGE)


if __name__ == "__main__":
    main()
