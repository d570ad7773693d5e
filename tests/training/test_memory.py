"""Memory that a training keeps."""

import platform
import resource

import pytest
import torch

from geoprior.training.memory import kept_memory

glibc = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries are left alone")


STEPS = """
import resource
import torch
from geoprior.training.memory import kept_memory

def step():
    return [torch.zeros(2**22) for _ in range(4)]  # 16 MiB each, freed at once

with kept_memory():
    for _ in range(6):  # until the holes between other blocks have their sizes
        step()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(5):
        step()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@glibc
def test_freed_blocks_cost_no_new_pages_while_they_are_kept(run_python):
    """In a process of its own: what other tests left in the heap decides where blocks find room."""
    assert int(run_python(STEPS)) < 1000  # of the 80,000 that the blocks have


@glibc
def test_what_was_kept_is_given_back_at_the_end():
    def resident():
        with open("/proc/self/statm") as file:  # noqa: PTH123
            return int(file.read().split()[1]) * resource.getpagesize()

    with kept_memory():
        blocks = [torch.zeros(2**24) for _ in range(4)]
        full = resident()
        del blocks
        assert resident() > full - 2**26
    assert resident() < full - 2**27


def test_an_error_passes_through():
    with pytest.raises(ZeroDivisionError), kept_memory():
        raise ZeroDivisionError
