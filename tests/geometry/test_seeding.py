"""Draws depend on their names and nothing else."""

from __future__ import annotations

import itertools
import subprocess
import sys

import numpy as np

from geoprior.geometry.seeding import generator, integer_seed, seed_sequence

NAMES = [(), ("a",), ("b",), ("a", 1), ("a", "1"), (1, "a"), ("a", 1, 0), ("a1",), (0,), (1,)]


def test_same_names_same_stream_whatever_was_drawn_before():
    first = generator(7, "generate", "pick", 3).random(8)
    generator(7, "generate", "pick", 2).random(100)
    np.random.default_rng(0).random(5)
    np.testing.assert_array_equal(generator(7, "generate", "pick", 3).random(8), first)


def test_other_names_or_roots_give_other_streams():
    heads = {tuple(generator(root, *names).integers(0, 2**62, 2)) for root in range(3) for names in NAMES}
    assert len(heads) == 3 * len(NAMES)


def test_streams_are_uncorrelated():
    draws = np.stack([generator(0, "generate", "pick", index).standard_normal(2000) for index in range(40)])
    correlations = np.corrcoef(draws)[np.triu_indices(40, 1)]
    assert np.abs(correlations).max() < 6.0 / np.sqrt(2000)


def test_the_stream_is_the_same_in_another_process_and_for_ever():
    code = "from geoprior.geometry.seeding import integer_seed; print(integer_seed(5, 'x', 2))"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(other.stdout) == integer_seed(5, "x", 2) == 8443388922410001259


def test_integer_seeds_fit_63_bits():
    for root, names in itertools.product(range(20), NAMES):
        assert 0 <= integer_seed(root, *names) < 2**63


def test_words_and_numbers_differ():
    assert seed_sequence(0, "1").generate_state(1) != seed_sequence(0, 1).generate_state(1)
