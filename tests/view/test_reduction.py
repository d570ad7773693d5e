import numpy as np

from geoprior.view.reduction import reduced


def test_pictures_of_few_colours_are_reduced_without_loss():
    rng = np.random.default_rng(0)
    colours = rng.integers(0, 256, size=(200, 3), dtype=np.uint8)
    pictures = list(colours[rng.integers(0, 200, size=(3, 40, 60))])
    for picture, image in zip(pictures, reduced(pictures), strict=True):
        np.testing.assert_array_equal(np.asarray(image.convert("RGB")), picture)


def test_pictures_of_many_colours_share_256_and_come_near():
    ramp = np.linspace(0, 255, 4096).astype(np.uint8).reshape(64, 64)
    pictures = [np.stack([ramp, ramp.T, np.full_like(ramp, level)], axis=-1) for level in (0, 120)]
    images = reduced(pictures)
    shown = [np.asarray(image.convert("RGB")) for image in images]
    assert len(np.unique(np.concatenate(shown).reshape(-1, 3), axis=0)) <= 256
    assert images[0].getpalette() == images[1].getpalette()
    for picture, approximation in zip(pictures, shown, strict=True):
        assert np.abs(picture.astype(int) - approximation).max() < 64
