"""Workers change nothing but the time, say what went wrong, and never stay behind."""

import multiprocessing
import os
import signal

import numpy as np
import pytest
from source_material import GENERATE, SLOTS, make_batches, read, same_batches, same_moments

from geoprior.errors import ConfigError, MachineError
from geoprior.options import Choice


@pytest.fixture
def alone(source_of):
    return make_batches(source_of("endless", keep=2, workers=0))


@pytest.mark.parametrize(("workers", "prefetch"), [(1, 2), (2, 0)])
def test_the_batches_are_those_of_no_worker_from_the_start_and_from_the_middle(
    source_of, alone, workers, prefetch
):
    source = source_of("endless", keep=2, workers=workers)
    assert len(multiprocessing.active_children()) == workers
    ahead = make_batches(source, prefetch=prefetch)
    for steps in (range(9), range(6, 12), range(2, 4)):
        found = list(ahead.stream(steps.start, steps.stop))
        assert all(same_batches(a, alone.batch(step)) for a, step in zip(found, steps, strict=True))
    source.close()
    assert multiprocessing.active_children() == []


def test_a_fault_of_a_worker_is_raised_here_with_its_hint_and_the_workers_end(source_of):
    config = GENERATE.model_copy(update={"motions": [Choice(name="place")], "seconds": 0.2})
    with pytest.raises(ConfigError, match="motion 'place': 2 steps are too few") as caught:
        source_of("endless", config=config, workers=1)
    assert "raise generate.fps" in caught.value.hint
    assert multiprocessing.active_children() == []


def test_an_unforeseen_error_of_a_worker_while_reading_ahead_is_raised_here(source_of):
    source = source_of("endless", workers=1)
    batches = make_batches(source, prefetch=2)
    batches._lengths = batches._lengths + 10**6
    batches._order = type("Late", (), {"samples": lambda _, first, count: np.full((count, 2), 999_999)})()
    with pytest.raises(IndexError, match="out of bounds"):
        list(batches.stream(0, 9))


def test_a_killed_worker_is_said_and_nothing_hangs(source_of):
    source = source_of("endless", workers=1)
    stream = make_batches(source, prefetch=2).stream(0, 1000)
    next(stream)
    (worker,) = multiprocessing.active_children()
    os.kill(worker.pid, signal.SIGKILL)
    with pytest.raises(MachineError, match="a process that makes episodes died"):
        list(stream)
    with pytest.raises(MachineError, match="a process that makes episodes died"):
        read(source, [0], [0])
    source.close()
    assert multiprocessing.active_children() == []


def test_ctrl_c_is_left_to_the_trainer(source_of):
    """A terminal sends it to the whole group: a worker that died of it would hide what was interrupted."""
    source = source_of("endless", workers=1)
    first = read(source, [0, 5], [3, 4])
    (worker,) = multiprocessing.active_children()
    os.kill(worker.pid, signal.SIGINT)
    assert same_moments(read(source, [0, 5], [3, 4]), first)


def test_closing_in_the_middle_of_reading_ahead_leaves_nothing(source_of):
    source = source_of("endless", keep=1, workers=1)
    stream = make_batches(source, prefetch=8, batch_size=SLOTS).stream(0, 1000)
    next(stream)
    source.close()
    source.close()
    stream.close()
    assert multiprocessing.active_children() == []
