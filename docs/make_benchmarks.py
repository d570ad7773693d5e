"""Write docs/benchmarks.md from benchmarks/results/*.json.

python docs/make_benchmarks.py            # writes it
python docs/make_benchmarks.py --check    # ends with 1 if it is not what the results say
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PAGE = ROOT / "docs" / "benchmarks.md"
HEAD = """# Benchmarks

Written by `python docs/make_benchmarks.py` from the files in benchmarks/results; do not edit by hand.
Each was measured by the command that stands with it, on the code of its time, with nothing else running
here; what other users of the machine do is not in our hands, and its speed swings twofold. A ratio compares
two sides that took turns in one run, unless a note says otherwise.
"""


def page() -> str:
    """The whole page."""
    contents = {path.stem: json.loads(path.read_text()) for path in sorted(RESULTS.glob("*.json"))}
    wanted = {"name", "command", "results"}
    parts = [section(name, content) for name, content in contents.items() if wanted <= content.keys()]
    return "\n".join([HEAD, *parts])


def section(name: str, content: dict[str, Any]) -> str:
    """One benchmark: where it ran, and a table."""
    machine, versions = content["machine"], content["versions"]
    packages = ", ".join(
        f"{name} {versions[name]}" for name in ("geoprior", "python", "torch", "mujoco", "numba")
    )
    lines = [
        f"## {name}",
        "",
        f"    {content['command']}",
        "",
        f"{machine['cores']} cores of {machine['processor']}; {packages}.",
        "",
        *([content["note"], ""] if "note" in content else []),
        "| what | measured | goal | |",
        "| --- | ---: | ---: | --- |",
        *(row(result) for result in content["results"]),
        "",
    ]
    return "\n".join(lines)


def row(result: dict[str, Any]) -> str:
    """One line of the table."""
    goal = "" if result["goal"] is None else f"{result['goal']:,.6g}"
    met = {None: "", True: "reached", False: "**missed**"}[result["met"]]
    value = result["value"]
    number = f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    return f"| {result['metric']} | {number} {result['unit']} | {goal} | {met} |"


def main() -> None:
    """Write the page, or compare it."""
    if "--check" in sys.argv[1:]:
        sys.exit(
            0 if PAGE.is_file() and PAGE.read_text() == page() else f"{PAGE}: run docs/make_benchmarks.py"
        )
    PAGE.write_text(page())
    print(PAGE)


if __name__ == "__main__":
    main()
