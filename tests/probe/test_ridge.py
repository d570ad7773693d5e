import numpy as np
import pytest

from geoprior.probe.ridge import cross_validated, fit_ridge, folds


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_a_linear_map_is_recovered_whatever_the_units(rng):
    x = rng.normal(size=(400, 5)) * [1e-3, 1.0, 1e3, 1.0, 1.0] + [5.0, 0.0, 0.0, -3.0, 0.0]
    weights, bias = rng.normal(size=(5, 3)) / x.std(axis=0)[:, None], rng.normal(size=3)
    found = fit_ridge(x, x @ weights + bias, penalty=1e-9)
    np.testing.assert_allclose(found.weights, weights, rtol=1e-4)
    np.testing.assert_allclose(found(x), x @ weights + bias, atol=1e-5)


def test_a_constant_feature_gets_no_weight_and_a_constant_target_is_told(rng):
    x = np.column_stack([rng.normal(size=50), np.full(50, 7.0)])
    found = fit_ridge(x, np.full((50, 1), 3.0))
    np.testing.assert_allclose(found.weights, 0.0, atol=1e-12)
    np.testing.assert_allclose(found(x), 3.0)


def test_a_larger_penalty_gives_smaller_weights(rng):
    x = rng.normal(size=(60, 4))
    y = x @ rng.normal(size=(4, 2)) + rng.normal(size=(60, 2))
    norms = [np.linalg.norm(fit_ridge(x, y, penalty).weights) for penalty in (1e-6, 1e-1, 10.0)]
    assert norms == sorted(norms, reverse=True)


def test_solved_in_rows_it_is_the_ridge_that_is_solved_in_features(rng):
    x, groups = rng.normal(size=(60, 6)), np.repeat(np.arange(12), 5)
    y = x @ rng.normal(size=(6, 2)) + 0.1 * rng.normal(size=(60, 2))
    expected = np.empty_like(y)
    for held in folds(groups):
        # The squares of a row add up to the number of standardised features, those of a feature to the rows'.
        penalty = 0.1 * x.shape[1] / (~held).sum()
        expected[held] = fit_ridge(x[~held], y[~held], penalty)(x[held])
    np.testing.assert_allclose(cross_validated(x, y, groups, (0.1,)), expected, rtol=1e-6)


def test_a_group_is_never_on_both_sides(rng):
    groups = rng.integers(0, 7, 40)
    masks = folds(groups)
    assert sum(mask.sum() for mask in masks) == 40
    for mask in masks:
        assert not set(groups[mask]) & set(groups[~mask])
    # What tells the group and nothing else cannot help.
    x = np.eye(10)[np.repeat(np.arange(10), 6)]
    y = rng.normal(size=(10, 1))[np.repeat(np.arange(10), 6)]
    read = cross_validated(x, y, np.repeat(np.arange(10), 6))
    assert np.abs(read - y).mean() > 0.5 * np.abs(y - y.mean()).mean()


def test_far_more_features_than_rows_are_no_hindrance(rng):
    place = rng.normal(size=(200, 2))
    x = place @ rng.normal(size=(2, 3000)) + 0.1 * rng.normal(size=(200, 3000))
    read = cross_validated(x, place, np.repeat(np.arange(50), 4))
    assert np.linalg.norm(read - place, axis=1).mean() < 0.1
