"""Attenuation tables: against the float64 reference, and what they must be as densities."""

import numpy as np
import pytest
from fibres import FIBRES

from furcl import bcsdf, layout
from furcl.buffers import Memory
from furcl.material import build_material, fibre_features
from furcl.tables import FLOOR, tables_from_bins


@pytest.mark.parametrize("name", FIBRES)
def test_joint_density_is_that_of_the_reference(device, name):
    fibre = FIBRES[name]
    material = build_material(Memory(device), fibre, fibre_features(fibre, sampling="full-cdf"))
    reference = bcsdf.attenuation_tables(fibre, material.profiles)
    expected = tables_from_bins(reference).joint
    assert material.tables is not None
    # The device's 16-point rule in a bin: measured within 0.4 % of the lobe's mean; at the edge of
    # the medulla the scattered lobes begin inside a bin.
    mean = expected.mean(axis=2, keepdims=True)
    assert np.max(np.abs(material.tables.joint - expected) / (expected + mean + 1e-30)) < 0.02


@pytest.fixture
def bins(rng):
    values = rng.uniform(0.0, 1.0, (4, 5, layout.TABLE_BINS))
    values[0, 3:] = 0.0  # lobes that do not exist
    values[1] = 0.0  # a row in which nothing carries light
    values[2, 1, 50:] = 0.0  # bins in which the quadrature saw nothing
    return values


def test_joint_density_integrates_to_one(bins):
    tables = tables_from_bins(bins)
    integral = tables.joint.astype(np.float64).sum(axis=(1, 2)) * 2 / layout.TABLE_BINS
    np.testing.assert_allclose(integral, [1, 0, 1, 1], rtol=1e-6)


def test_cdfs_end_at_one_and_never_fall(bins):
    tables = tables_from_bins(bins)
    assert np.all(np.diff(tables.bin_cdf, axis=2) >= 0)
    assert np.all(tables.bin_cdf[..., -1] == 1)
    np.testing.assert_array_equal(tables.lobe_cdf[:, -1], [1, 0, 1, 1])
    # A lobe without energy is never chosen, whatever the rounding of the sums before it.
    assert np.all(tables.lobe_cdf[0, 2:] == 1)


def test_densities_are_those_of_the_cdfs(bins):
    tables = tables_from_bins(bins)
    lobe = np.diff(tables.lobe_cdf.astype(np.float64), prepend=0, axis=1)
    inside = np.diff(tables.bin_cdf.astype(np.float64), prepend=0, axis=2)
    expected = lobe[..., None] * inside * layout.TABLE_BINS / 2
    np.testing.assert_allclose(tables.joint, expected, atol=2e-6)


def test_empty_bins_get_the_floor(bins):
    tables = tables_from_bins(bins)
    mean = bins[2, 1].mean()
    np.testing.assert_allclose(
        tables.joint[2, 1, 50:] / tables.joint[2, 1, :50].mean(),
        FLOOR * mean / bins[2, 1, :50].mean(),
        rtol=1e-5,
    )
