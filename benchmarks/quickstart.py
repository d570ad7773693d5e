"""Time and memory of the quickstart, stage by stage, in a fresh folder.

    python -m benchmarks quickstart --json benchmarks/results/quickstart.json --keep runs/quickstart

Runs ``geoprior run`` as a user does and reads the stages' seconds from ``run.json``. Memory is the largest
sum over the process and its workers of what each holds alone plus its share of what they share (the kernel's
proportional set size), read every half second from /proc.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

GOAL_SECONDS = 300.0
GOAL_BYTES = 3 << 30


def memory_bytes(pid: int) -> int:
    """Proportional set size of a process and all its descendants."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0
    own = sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return own * 1024 + sum(memory_bytes(int(child)) for child in children)


def measure(config: str, out: Path) -> tuple[float, int]:
    """Wall seconds and peak bytes of one run."""
    command = [sys.executable, "-m", "geoprior", "run", config, "--out", str(out)]
    began, peak = time.monotonic(), 0
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            peak = max(peak, memory_bytes(process.pid))
            time.sleep(0.5)
    if process.returncode:
        sys.exit(process.returncode)
    return time.monotonic() - began, peak


def results(seconds: float, peak: int, run: dict) -> list[dict]:
    """What ``python -m benchmarks`` prints for every benchmark: metric, value, unit, goal, met."""
    rows = [
        ("whole run", round(seconds, 1), "s", GOAL_SECONDS, seconds <= GOAL_SECONDS),
        ("peak memory", round(peak / 2**20), "MiB", GOAL_BYTES / 2**20, peak <= GOAL_BYTES),
    ]
    rows += [(f"stage {name}", stage["seconds"], "s", None, None) for name, stage in run["stages"].items()]
    return [dict(zip(("metric", "value", "unit", "goal", "met"), row, strict=True)) for row in rows]


def main() -> None:
    """Run, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--config", default="quickstart")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    parser.add_argument(
        "--keep", type=Path, help="a new folder for the run; without it the run is thrown away"
    )
    options = parser.parse_args()
    if options.keep is not None and options.keep.exists():
        sys.exit(f"{options.keep}: is there already; a measurement begins in a new folder")
    with tempfile.TemporaryDirectory() as folder:
        out = options.keep or Path(folder) / "run"
        seconds, peak = measure(options.config, out)
        run = json.loads((out / "run.json").read_text())
        found = json.loads((out / "results.json").read_text())
    content = {
        "name": "quickstart",
        "command": f"python -m benchmarks quickstart --config {options.config}",
        "machine": run["machine"],
        "versions": run["versions"],
        "results": results(seconds, peak, run),
        "outcome": found,
    }
    text = json.dumps(content, indent=2)
    print(text)
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(text + "\n")


if __name__ == "__main__":
    main()
