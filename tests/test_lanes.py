"""Compiled loops on torch's threads."""

import threading

import numpy as np
import pytest
import torch
from numba import prange

from geoprior.compiled import shared
from geoprior.lanes import GRAIN, in_lanes, numbers_of


@shared
def mark(lanes, marks):
    for lane in prange(lanes):
        for i in range(marks.size * lane // lanes, marks.size * (lane + 1) // lanes):
            marks[i] += lane + 1


def test_every_item_is_met_once_and_lanes_come_with_the_work():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        for numbers, lanes in ((1, 1), (2 * GRAIN - 1, 1), (2 * GRAIN, 2), (100 * GRAIN, 2)):
            marks = np.zeros(10, np.int64)
            in_lanes(mark, numbers, marks)
            expected = np.repeat(np.arange(1, lanes + 1), 10 // lanes)
            np.testing.assert_array_equal(marks, expected)
    finally:
        torch.set_num_threads(before)


def test_torchs_number_of_threads_is_left_alone():
    before = torch.get_num_threads()
    for threads in (1, 2):
        torch.set_num_threads(threads)
        in_lanes(mark, 10 * GRAIN, np.zeros(4, np.int64))
        assert torch.get_num_threads() == threads
    torch.set_num_threads(before)


def test_two_threads_of_python_may_call_at_once():
    marks = [np.zeros(1000, np.int64) for _ in range(4)]

    def work(mine):
        for _ in range(200):
            in_lanes(mark, 2 * GRAIN, mine)

    threads = [threading.Thread(target=work, args=(mine,)) for mine in marks]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all((mine >= 200).all() for mine in marks)


def test_numbers_of_a_tensor_are_a_view():
    x = torch.tensor([1.0, -2.0], dtype=torch.bfloat16, requires_grad=True)
    bits = numbers_of(x)
    assert bits.dtype == np.uint16
    assert bits.tolist() == [0x3F80, 0xC000]
    y = torch.zeros(3)
    numbers_of(y)[1] = 4.0
    assert y.tolist() == [0.0, 4.0, 0.0]


COUNT_THREADS = """
import os
from concurrent.futures import ThreadPoolExecutor
import torch
from geoprior.lanes import stay_alone

def threads():
    return len(os.listdir("/proc/self/task"))

torch.set_num_threads(2)
x = torch.ones(2**22)
x + 1
before = threads()
with ThreadPoolExecutor(1, initializer={initializer}) as pool:
    pool.submit(torch.add, x, 1).result()
    print(threads() - before, torch.get_num_threads())
"""


@pytest.mark.parametrize(("initializer", "more"), [("None", 2), ("stay_alone", 1)])
def test_a_python_thread_that_stays_alone_brings_no_team(initializer, more, run_python):
    """And the number of torch's threads elsewhere is what it was."""
    assert run_python(COUNT_THREADS.format(initializer=initializer)).split() == [str(more), "2"]
