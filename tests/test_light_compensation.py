"""What light samples leave to the samples of materials (furcl/light/compensation.py)."""

import numpy as np
import pytest
from environments import ANYWHERE

from furcl.light.compensation import LEAST, SHARE, compensated_power
from furcl.light.image import ImageLight
from furcl.light.latlong import LatLong
from furcl.light.sky import SkyEnvironment, SkyLight

SPHERE = 4.0 * np.pi


def test_a_part_of_the_mean_is_taken_off():
    """Two halves of radiance 3 and 1: mean 2, less 1.5."""
    found = compensated_power(np.array([3.0, 1.0]) * SPHERE / 2, np.full(2, SPHERE / 2))
    np.testing.assert_allclose(found / (SPHERE / 2), [3.0 - SHARE * 2.0, LEAST], rtol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 50])
def test_even_light_stays_even(n):
    angles = np.full(n, SPHERE / n)
    found = compensated_power(2.0 * angles, angles)
    np.testing.assert_allclose(found, 2.0 * (1.0 - SHARE) * angles)


def test_no_part_loses_its_light(rng):
    power = rng.exponential(size=1000) ** 4
    power[::7] = 0.0
    found = compensated_power(power, np.full(1000, SPHERE / 1000))
    assert ((found > 0.0) == (power > 0.0)).all()
    assert (found <= power).all()
    assert (found >= LEAST * power).all()


def test_light_samples_seek_the_sun():
    """The sun of a third of the light gets most of the samples of sky and image."""
    sky = SkyLight.from_table(SkyEnvironment(sun_radius_deg=20.0, sun_scale=0.6, scale=0.05))
    power = sky.sky.sun_power().sum()
    rest = sky.sky.sky_integral(cosine=False).sum() + 2.0 * np.pi * sky.sky.ground_radiance.sum()
    assert power / (power + rest) < 0.45
    assert sky.chances[0] > 0.8
    rgb = np.ones((32, 64, 3), np.float32)
    rgb[10:14, 20:24] = 60.0
    light = ImageLight(LatLong.make(rgb))
    share = light.image.texels[10:14, 20:24].sum() / light.image.texels.sum()
    samples = light.sample(ANYWHERE, np.random.default_rng(1).random((4000, 2)))
    assert share < 0.4
    assert (samples.radiance[:, 0] > 1.0).mean() > 0.6
