import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoprior.probe.sight import REMEDY, Sight, as_metrics, from_metrics, judgement, warning

NUMBERS = st.floats(-5.0, 5.0)
SIGHTS = st.builds(Sight, NUMBERS, NUMBERS, st.none() | NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS)


def sight(true=0.2, shuffled=0.4, still=0.3, pose_only=0.28, error=0.01):
    return Sight(true, shuffled, None, still, pose_only, shuffled - true, error)


@given(st.dictionaries(st.sampled_from(["all", "pick", "random-walk", "my_motion"]), SIGHTS))
def test_what_is_logged_is_read_back(measured):
    logged = {"loss": 1.0, "l1": 0.5, "step": 3, "true": 9.0, **as_metrics(measured)}
    assert from_metrics(logged) == measured


def test_the_names_of_a_log_are_plain():
    names = as_metrics({"all": sight(), "pick": sight()})
    for measure in ("vision_gain", "vision_gain_se", "true_l1", "shuffled_l1", "still_l1", "pose_only_l1"):
        assert names[measure] == names[f"{measure}_pick"]
    assert "black_l1" not in names


def test_a_log_without_it_or_with_a_hole_says_nothing():
    assert from_metrics({"l1": 0.1, "held_out_l1": 0.2}) == {}
    holed = as_metrics({"all": sight()})
    holed["shuffled_l1"] = None
    assert from_metrics(holed) == {}
    assert warning({}) == ""


@pytest.mark.parametrize(
    ("one", "parts"),
    [
        (sight(), ()),
        (sight(shuffled=0.21, error=0.01), ("does not look",)),
        (sight(shuffled=0.19), ("does not look",)),
        (sight(still=0.19), ("not below", "standing still, 0.190")),
        (sight(pose_only=0.19), ("not below", "the pose alone, 0.190")),
        (sight(shuffled=0.2, error=0.0, still=0.1), ("does not look", "standing still")),
    ],
)
def test_a_blind_prior_is_warned_of(one, parts):
    text = warning({"all": one, "pick": sight(shuffled=0.1)})
    assert bool(text) == bool(parts)
    for part in parts:
        assert part in text
    assert "pretrain.epochs" in REMEDY


def test_the_sentence_says_whether_it_looks_and_whether_that_pays():
    assert judgement(sight()).startswith("This policy looks")
    assert judgement(sight(shuffled=0.205, error=0.001)).startswith("This policy barely looks")
    assert "yet standing still does better" in judgement(sight(still=0.1))
    assert judgement(sight(shuffled=0.2)).startswith("This policy does not look")
