import multiprocessing
import os
import signal
import threading
import time

import pytest

from geoprior.errors import DataError, MachineError
from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor


def square(number):
    return number * number


def fail_at_three(number):
    if number == 3:
        raise DataError("three is damaged", "take four")
    return number


def die_at_three(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fail_at_three_or_take_an_hour(number):
    if number != 3:
        time.sleep(3600)
    return fail_at_three(number)


def threads_of_libraries(_):
    import numpy as np
    import torch
    from threadpoolctl import threadpool_info

    np.ones((64, 64)) @ np.ones((64, 64))
    return [torch.get_num_threads(), *(each["num_threads"] for each in threadpool_info())]


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core is all there is")
def test_a_worker_uses_one_core():
    ((_, threads),) = LocalExecutor(LocalConfig(workers=1)).run(threads_of_libraries, [0])
    assert set(threads) == {1}
    assert len(threads) > 1


@pytest.mark.parametrize("executor", [SerialExecutor(), LocalExecutor(LocalConfig(workers=2))])
def test_every_item_comes_back_once_with_its_position(executor):
    items = [5, 1, 4, 2]
    assert dict(executor.run(square, items)) == {0: 25, 1: 1, 2: 16, 3: 4}


@pytest.mark.parametrize("executor", [SerialExecutor(), LocalExecutor(LocalConfig(workers=2))])
def test_no_items_no_work(executor):
    assert list(executor.run(square, [])) == []


def test_an_error_of_a_worker_comes_back_with_its_hint():
    with pytest.raises(DataError, match="three is damaged") as caught:
        list(LocalExecutor(LocalConfig(workers=2)).run(fail_at_three, list(range(6))))
    assert caught.value.hint == "take four"


def test_a_killed_worker_is_said_and_nothing_hangs():
    began = time.monotonic()
    with pytest.raises(MachineError, match="worker process died"):
        list(LocalExecutor(LocalConfig(workers=2)).run(die_at_three, list(range(6))))
    assert time.monotonic() - began < 60


def test_stopping_early_leaves_no_workers():
    results = LocalExecutor(LocalConfig(workers=2)).run(square, list(range(50)))
    next(results)
    results.close()
    assert multiprocessing.active_children() == []


def test_an_error_does_not_wait_for_what_else_is_being_done():
    began = time.monotonic()
    with pytest.raises(DataError, match="three is damaged"):
        list(LocalExecutor(LocalConfig(workers=2)).run(fail_at_three_or_take_an_hour, [1, 3]))
    assert time.monotonic() - began < 60
    assert multiprocessing.active_children() == []


def test_ctrl_c_does_not_wait_for_what_is_being_done():
    def press():
        time.sleep(2.0)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    began = time.monotonic()
    threading.Thread(target=press).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            list(LocalExecutor(LocalConfig(workers=2)).run(fail_at_three_or_take_an_hour, [1, 2]))
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - began < 60
    assert multiprocessing.active_children() == []
