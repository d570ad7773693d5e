from collections import defaultdict

from hypothesis import given
from hypothesis import strategies as st

from geoprior.sources._turnover import Turnover

turnovers = st.builds(Turnover, slots=st.integers(1, 25), keep=st.integers(1, 12))


def epochs_of(turnover, epochs):
    """The episodes of each epoch, by slot."""
    slots = turnover.slots
    return [[turnover.episode(epoch * slots + slot) for slot in range(slots)] for epoch in range(epochs)]


@given(turnover=turnovers)
def test_the_first_epochs_have_the_first_episodes(turnover):
    for epoch in epochs_of(turnover, turnover.keep):
        assert epoch == list(range(turnover.slots))


@given(turnover=turnovers)
def test_an_episode_stays_in_its_slot_so_long_and_never_comes_back(turnover):
    keep = turnover.keep
    stays = defaultdict(list)
    epochs = epochs_of(turnover, 6 * keep)
    for number, episodes in enumerate(epochs):
        assert len(set(episodes)) == turnover.slots
        for slot, episode in enumerate(episodes):
            stays[episode].append((number, slot))
    for episode, places in stays.items():
        first, last = places[0][0], places[-1][0]
        assert [epoch for epoch, _ in places] == list(range(first, last + 1))
        assert {slot for _, slot in places} == {episode % turnover.slots}
        if episode < turnover.slots:
            assert keep <= len(places) < 2 * keep
        elif last + 1 < len(epochs):
            assert len(places) == keep
        else:
            assert len(places) <= keep


@given(turnover=turnovers)
def test_renewal_is_spread_evenly(turnover):
    slots, keep = turnover.slots, turnover.keep
    epochs = epochs_of(turnover, 6 * keep)
    for before, after in zip(epochs[keep - 1 :], epochs[keep:], strict=False):
        renewed = sum(old != new for old, new in zip(before, after, strict=True))
        assert slots // keep <= renewed <= -(-slots // keep)


@given(turnover=turnovers, numbers=st.lists(st.integers(0, 10**12), min_size=1))
def test_fresh_episodes_continue_the_numbers(turnover, numbers):
    for number in numbers:
        episode = turnover.episode(number)
        assert episode % turnover.slots == number % turnover.slots
        assert 0 <= episode <= number
