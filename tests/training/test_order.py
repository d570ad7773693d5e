import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoprior.training.order import SampleOrder, steps_until

lengths = st.lists(st.integers(1, 30), min_size=1, max_size=12)


@given(lengths=lengths, seed=st.integers(0, 2**40), epoch=st.integers(0, 1000), early=st.floats(1.0, 4.0))
def test_an_epoch_holds_every_episode_once_at_a_step_it_has(lengths, seed, epoch, early):
    samples = SampleOrder(seed, lengths, early).samples(epoch * len(lengths), len(lengths))
    assert sorted(samples[:, 0]) == list(range(len(lengths)))
    assert (samples[:, 1] >= 0).all()
    assert (samples[:, 1] < np.array(lengths)[samples[:, 0]]).all()


@given(
    lengths=lengths,
    seed=st.integers(0, 99),
    first=st.integers(0, 200),
    count=st.integers(1, 60),
    early=st.sampled_from([1.0, 1.5]),
)
def test_a_place_is_a_pure_function_of_seed_and_position(lengths, seed, first, count, early):
    """However it is asked for: in one go, over the borders of epochs, alone, or backwards."""
    together = SampleOrder(seed, lengths, early).samples(first, count)
    order = SampleOrder(seed, lengths, early)
    alone = [order.samples(position, 1)[0] for position in reversed(range(first, first + count))]
    np.testing.assert_array_equal(together, alone[::-1])


def test_the_order_is_the_one_that_results_were_published_with():
    """Over the border of two epochs. Another order is another training."""
    samples = SampleOrder(1, [100] * 6).samples(4, 8)
    expected = [[0, 70], [3, 85], [4, 62], [5, 62], [3, 96], [1, 60], [2, 60], [0, 97]]
    np.testing.assert_array_equal(samples, expected)


def test_epochs_and_seeds_differ():
    order = SampleOrder(0, [50] * 20)
    first, second = order.samples(0, 20), order.samples(20, 20)
    assert not np.array_equal(first, second)
    assert not np.array_equal(first, SampleOrder(1, [50] * 20).samples(0, 20))


def test_time_steps_are_uniform():
    samples = SampleOrder(3, [4]).samples(0, 4000)[:, 1]
    counts = np.bincount(samples, minlength=4)
    # Four standard deviations of a binomial count.
    assert (abs(counts - 1000) < 4 * np.sqrt(4000 * 0.25 * 0.75)).all()


@pytest.mark.parametrize("early", [1.5, 2.0, 4.0])
def test_early_time_steps_come_as_often_as_is_said(early):
    """Of N steps the first x N get the share x ** (1 / early) of the samples."""
    times = SampleOrder(3, [80]).samples(0, 4000)[:, 1], SampleOrder(3, [80], early).samples(0, 4000)[:, 1]
    for share in (0.05, 0.25, 0.5, 0.9):
        evenly, found = (float((each < 80 * share).mean()) for each in times)
        expected = share ** (1.0 / early)
        assert found == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / 4000))
        assert found > evenly


@pytest.mark.parametrize(
    ("epoch", "episodes", "batch_size", "steps"),
    [(256, 20, 64, 80), (1, 5, 64, 1), (3, 5, 4, 4), (0, 5, 4, 0)],
)
def test_steps_until_an_epoch_is_complete(epoch, episodes, batch_size, steps):
    assert steps_until(epoch, episodes, batch_size) == steps
