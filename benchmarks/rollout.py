"""How fast an arm is stepped and seen, against robosuite's own loop.

Ours runs in two processes, as a rollout on two cores does; robosuite in one, with its own observations. Both
draw two cameras of 128 x 128. Slices of both sides alternate, so that whatever else the machine does meets
both.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from statistics import median

from benchmarks.metrics import Metric, at_least
from benchmarks.stepping import Drive, measure_costs, step_ours, step_stock

PROCESSES = 2
RATIO_GOAL = 20.0
GOAL_DRIVE = Drive("fast", 1)
DRIVES = (GOAL_DRIVE, Drive("fast", 8), Drive("exact", 1), Drive("exact", 8))
ROUNDS, SECONDS = 7, 3.0
"""Slices of every kind, and how long each lasts."""


def measure() -> Iterator[Metric]:
    """Seven slices of three seconds for each way to roll out and for robosuite (some 3 minutes)."""
    yield from _measure(ROUNDS, SECONDS, RATIO_GOAL)


def measure_quickly() -> Iterator[Metric]:
    """Two slices of half a second."""
    yield from _measure(2, 0.5, None)


def _measure(rounds: int, seconds: float, goal: float | None) -> Iterator[Metric]:
    with ExitStack() as stack:
        workers = [stack.enter_context(_process()) for _ in range(PROCESSES)]
        stock = stack.enter_context(_process())
        _run_slices(workers, stock, seconds=0.1)  # builds, compiles and warms up
        slices = [_run_slices(workers, stock, seconds) for _ in range(rounds)]
        costs = {
            controller: workers[0].submit(measure_costs, controller).result()
            for controller in dict.fromkeys(drive.controller for drive in DRIVES)
        }
    stock_rates = [rates[None] for rates in slices]
    yield from _told("robosuite's own loop, 1 process", stock_rates, "steps/s")
    for drive in DRIVES:
        rates = [of_slice[drive] for of_slice in slices]
        yield from _told(f"{_name(drive)}, {PROCESSES} processes", rates, "steps/s")
        ratios = [rate / stock for rate, stock in zip(rates, stock_rates, strict=True)]
        yield from _told(
            f"{_name(drive)}: over robosuite", ratios, "x", goal if drive == GOAL_DRIVE else None
        )
    for controller, parts in costs.items():
        for part, milliseconds in asdict(parts).items():
            yield Metric(f"{controller}: {part} of a step with both frames", milliseconds, "ms")


def _run_slices(
    workers: list[ProcessPoolExecutor], stock: ProcessPoolExecutor, seconds: float
) -> dict[Drive | None, float]:
    """Control steps a second of every drive, all processes together, and under None of robosuite."""
    rates: dict[Drive | None, float] = {None: stock.submit(step_stock, seconds).result().rate}
    for drive in DRIVES:
        running = [worker.submit(step_ours, drive, seconds) for worker in workers]
        rates[drive] = sum(slice_.result().rate for slice_ in running)
    return rates


def _told(name: str, values: list[float], unit: str, goal: float | None = None) -> Iterator[Metric]:
    """The median and the extremes of the slices."""
    middle = median(values)
    yield Metric(name, middle, unit) if goal is None else at_least(name, middle, unit, goal)
    yield Metric(f"{name}: lowest slice", min(values), unit)
    yield Metric(f"{name}: highest slice", max(values), unit)


def _name(drive: Drive) -> str:
    looks = "every step" if drive.look_every == 1 else f"every {drive.look_every}th step"
    return f"{drive.controller}, frames at {looks}"


def _process() -> ProcessPoolExecutor:
    """A process of its own that keeps its environments, started afresh: GL contexts do not survive a fork."""
    return ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn"))
