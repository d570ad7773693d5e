import numpy as np
import pytest
import torch

from geoprior.errors import DataError
from geoprior.policies.normalise import (
    IMAGE_MEAN,
    IMAGE_STD,
    FeatureStatistics,
    Normaliser,
    measure,
    merge,
    normalise_images,
    statistics_from_json,
    statistics_to_json,
)


def rows(seed, count, channels=3):
    return np.random.default_rng(seed).normal(2.0, 5.0, size=(count, channels)).astype(np.float32)


def both(table):
    return {"pose": measure([table]), "action": measure([table])}


def test_measures_over_all_rows_of_all_episodes():
    parts = [rows(0, 4), rows(1, 9)]
    statistics = measure(parts)
    table = np.concatenate(parts).astype(np.float64)
    np.testing.assert_allclose(statistics.mean, table.mean(0))
    np.testing.assert_allclose(statistics.std, table.std(0))
    assert statistics.count == 13


def test_nothing_to_measure_is_an_error():
    with pytest.raises(DataError, match="no time steps"):
        measure([])


def test_merging_is_measuring_together():
    first, second = rows(0, 4), rows(1, 90) * 3
    merged = merge(both(first), both(second))["pose"]
    together = measure([first, second])
    np.testing.assert_allclose(merged.mean, together.mean)
    np.testing.assert_allclose(merged.std, together.std)
    assert merged.count == together.count


def test_merging_refuses_what_does_not_match():
    with pytest.raises(DataError, match="'action' has 3 channels in one data set, 4"):
        merge(both(rows(0, 4)), both(rows(0, 4, 4)))
    with pytest.raises(DataError, match="'action' has no statistics, only: pose"):
        merge(both(rows(0, 4)), {"pose": measure([rows(0, 4)])})


def test_round_trip_and_scale():
    table = rows(3, 200)
    normaliser = Normaliser(both(table))
    normalised = normaliser.normalise("pose", table)
    assert normalised.dtype == np.float32
    np.testing.assert_allclose(normalised.mean(0), 0.0, atol=1e-5)
    np.testing.assert_allclose(normalised.std(0), 1.0, atol=1e-5)
    np.testing.assert_allclose(normaliser.denormalise("pose", normalised), table, atol=1e-5)


def test_a_constant_channel_is_divided_by_the_floor():
    table = rows(3, 50)
    table[:, 1] = 7.0
    normaliser = Normaliser(both(table))
    moved = table[:1] + np.float32(0.005)
    np.testing.assert_allclose(normaliser.normalise("action", moved)[0, 1], 0.5, rtol=1e-4)


def test_a_feature_without_statistics_is_named():
    with pytest.raises(DataError, match="'action' has no statistics, only: pose"):
        Normaliser({"pose": measure([rows(0, 4)])})


def test_json_keeps_every_bit():
    statistics = both(rows(5, 17))
    assert statistics_from_json(statistics_to_json(statistics), 3) == statistics
    assert isinstance(statistics["pose"], FeatureStatistics)


def test_images_are_scaled_as_imagenet_and_binary_ones_repeated():
    frames = torch.randint(0, 256, (2, 3, 4, 5, 3), dtype=torch.uint8)
    images = normalise_images(frames)
    assert images.shape == (2, 3, 3, 4, 5)
    expected = (frames.double() / 255 - torch.tensor(IMAGE_MEAN)) / torch.tensor(IMAGE_STD)
    torch.testing.assert_close(images, expected.movedim(-1, -3).float(), atol=1e-5, rtol=1e-5)
    binary = normalise_images(frames[..., :1])
    torch.testing.assert_close(binary, normalise_images(frames[..., :1].expand(frames.shape)))
    assert images.flatten(0, 1).is_contiguous(memory_format=torch.channels_last)
