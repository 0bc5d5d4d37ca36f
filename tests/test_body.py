"""Rays against the body, an ellipsoid, beside float64."""

from __future__ import annotations

import numpy as np
from kernel_harness import call
from ray_reference import unit

from furcl.device.features import Features
from furcl.surface.ellipsoid import PART

CENTRE, RADII = np.array([0.3, -0.2, 0.5]), np.array([0.5, 1.0, 2.0])
WRAPPER = """
static float body_t(float3 origin, float3 direction)
{
    const SurfaceParams body = {(float4)(0.3f, -0.2f, 0.5f, 0.0f), (float4)(2.0f, 1.0f, 0.5f, 0.0f),
                       (float4)(0.0f)};
    const Query query = {origin, normalize(direction), FURCL_NO_SEGMENT};
    Hit hit = {1e30f, 0.5f, FURCL_NO_SEGMENT};
    const bool found = surface_hit(&body, &query, &hit);
    if (found != (hit.segment == FURCL_SURFACE_HIT)) return -2.0f;
    return found ? hit.t : -1.0f;
}
"""


def body_distance(device, origins, directions):
    """Distance to the body on the device, -1 for a miss."""
    return call(
        device,
        "surface/ellipsoid.clh",
        "body_t((float3)(x, y, z), (float3)(a, b, c))",
        *origins.T,
        *directions.T,
        features=Features(surface=PART),
        before=WRAPPER,
    )


def test_distances_are_those_of_the_quadratic_equation(device, rng):
    origins = CENTRE + unit(rng.standard_normal((20_000, 3))) * rng.uniform(2.1, 50.0, (20_000, 1))
    target = CENTRE + 1.2 * RADII * rng.uniform(-1.0, 1.0, origins.shape)
    directions = unit(target - origins)
    t = body_distance(device, origins, directions)
    p, v = (origins - CENTRE) / RADII, directions / RADII
    a, b, c = (v * v).sum(1), (p * v).sum(1), (p * p).sum(1) - 1.0
    discriminant = b * b - a * c
    certain = np.abs(discriminant) > 1e-3 * b * b
    hit = discriminant > 0.0
    assert np.array_equal((t > 0.0)[certain], hit[certain])
    both = certain & hit
    expected = (-b - np.sqrt(np.where(both, discriminant, 1.0))) / a
    assert 0.2 < both.mean() < 0.9
    assert np.abs(t - expected)[both].max() < 1e-4
    assert (np.abs(t - expected) / expected)[both].max() < 1e-5


def test_rays_that_start_on_the_body(device, rng):
    """Outwards nothing is in the way; inwards the way ends at once."""
    normal = unit(rng.standard_normal((5000, 3)))
    directions = unit(rng.standard_normal((5000, 3)))
    along = (normal * directions / RADII).sum(axis=1)
    directions = directions[np.abs(along) > 0.1]
    normal, along = normal[np.abs(along) > 0.1], along[np.abs(along) > 0.1]
    for factor in (0.9999, 1.0001):
        t = body_distance(device, CENTRE + factor * RADII * normal, directions)
        assert (t[along > 0.0] == -1.0).all()
        assert (t[along < 0.0] >= 0.0).all()
        assert (t[along < 0.0] < 0.1).all()


def test_rays_from_inside(device, rng):
    """Half of them go outwards and leave."""
    origins = CENTRE + 0.9 * RADII * unit(rng.standard_normal((5000, 3)))
    directions = unit(rng.standard_normal((5000, 3)))
    outwards = ((origins - CENTRE) / RADII**2 * directions).sum(axis=1)
    t = body_distance(device, origins, directions)
    sure = np.abs(outwards) > 1e-3
    assert np.array_equal((t == -1.0)[sure], (outwards > 0.0)[sure])
