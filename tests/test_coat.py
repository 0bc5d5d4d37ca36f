"""Coats of meshes: their table, value and density against float64, samples, energy in pictures."""

from __future__ import annotations

import numpy as np
import pytest
from direction_statistics import SphereBins, chi_square_p, sidak
from kernel_mutants import substitute
from light_kernels import launch
from test_mesh_light import alone, ball, mean_and_error

import furcl
from furcl.device import layout
from furcl.device.features import Features
from furcl.device.source import expand
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides
from furcl.surface.mesh.coat import COAT_HEAD, COAT_NODES, Coat
from furcl.surface.mesh.mesh import EVERY_MESH

ALBEDO = np.array([0.9, 0.5, 0.1])
COATS = {
    "skin": Coat(1.4, 0.45),
    "gloss": Coat(1.5, 0.1),
    "diamond": Coat(2.4, 0.7),
    "rough": Coat(1.4, 1.0),
}


NODES = np.polynomial.legendre.leggauss(1000)


def dot(a, b):
    return (a * b).sum(axis=-1)


class Reference:
    """The coat in float64, in the form of the papers: angles, not cosines."""

    def __init__(self, coat: Coat):
        self.eta, self.alpha, self.base = coat.eta, coat.roughness**2, coat

    def fresnel(self, cosine):
        into = np.arccos(np.clip(cosine, 0.0, 1.0 - 1e-9))
        out = np.arcsin(np.sin(into) / self.eta)
        across = np.sin(into - out) / np.sin(into + out)
        return 0.5 * (across**2 + (np.tan(into - out) / np.tan(into + out)) ** 2)

    def masking(self, cosine):
        tangent = np.tan(np.arccos(np.clip(cosine, 1e-12, 1.0)))
        return 0.5 * (np.sqrt(1.0 + (self.alpha * tangent) ** 2) - 1.0)

    def facets(self, cosine):
        """GGX's distribution of normals."""
        square = cosine**2
        return self.alpha**2 / (np.pi * ((self.alpha**2 - 1.0) * square + 1.0) ** 2)

    def albedo(self, cosine):
        """Directional albedo, over normals drawn by their distribution."""
        at, weights = NODES
        u, w = 0.5 * (at[:, None] + 1.0), 0.5 * weights[:, None]
        theta = np.arctan(self.alpha * np.sqrt(u / (1.0 - u)))
        phi = (np.arange(200) + 0.5) * (np.pi / 200)
        towards = np.cos(theta) * cosine + np.sin(theta) * np.cos(phi) * np.sqrt(1 - cosine**2)
        to_light = 2.0 * towards * np.cos(theta) - cosine
        seen = (towards > 0.0) & (to_light > 0.0)
        shadowed = 1.0 + self.masking(cosine) + self.masking(np.where(seen, to_light, 1.0))
        each = self.fresnel(towards) * towards / (shadowed * cosine * np.cos(theta))
        return float((w * np.where(seen, each, 0.0)).sum() / 200)

    def table(self, cosine):
        nodes = np.linspace(0.0, 1.0, len(self.base.albedos()))
        return np.interp(np.sqrt(cosine), nodes, self.base.albedos())

    def around(self, normal, out, direction):
        """Value (n, 3), cosine included, and density (n,), for unit rows."""
        cos_i, cos_o = dot(direction, normal), dot(out, normal)
        above = cos_i > 0.0
        cos_i = np.where(above, cos_i, 1.0)
        half = out + direction
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
        facets = self.facets(dot(half, normal)) / (4.0 * cos_o)
        masked = 1.0 + self.masking(cos_o)
        mirror = self.fresnel(dot(half, out)) * facets / (masked + self.masking(cos_i))
        albedo = self.table(cos_o)
        under = (1.0 - albedo) * (1.0 - self.table(cos_i)) / (1.0 - self.base.mean_albedo())
        value = mirror[:, None] + (under * cos_i / np.pi)[:, None] * ALBEDO
        chance = albedo / (albedo + (1.0 - albedo) * ALBEDO.mean())
        density = chance * facets / masked + (1.0 - chance) * cos_i / np.pi
        return np.where(above[:, None], value, 0.0), np.where(above, density, 0.0)

    def reflection(self, normal, face, out, direction):
        """The same with what is below the face mirrored at it."""
        value, density = self.around(normal, out, direction)
        below = direction - 2.0 * dot(direction, face)[:, None] * face
        more = self.around(normal, out, below)
        up = dot(direction, face) > 0.0
        return np.where(up[:, None], value + more[0], 0.0), np.where(up, density + more[1], 0.0)


KERNEL = """
__kernel void reflect(
    __global const float* coat, __global const float* normals, __global const float* faces,
    __global const float* outs, __global const float* given, __global const float* xi,
    __global float* directions, __global float* values, __global float* densities)
{
    const uint i = get_global_id(0);
    SurfacePoint at;
    at.normal = vload3(i, normals);
    at.face = vload3(i, faces);
    at.albedo = (float3)(0.9f, 0.5f, 0.1f);
    at.coat = coat;
    Reflection r;
    float3 direction = vload3(i, given);
    if (dot(direction, direction) > 0.0f) r = coat_reflection(&at, vload3(i, outs), direction);
    else direction = coat_sample(&at, vload3(i, outs), vload3(i, xi), &r);
    vstore3(direction, i, directions);
    vstore3(r.value, i, values);
    densities[i] = r.pdf;
}
"""


def reflect(device, coat, normals, faces, outs, given=None, xi=None, mutant=("", "")):
    """Directions, values and densities of the device: of directions, or of samples by numbers."""
    features = Features(meshes=EVERY_MESH)
    text = expand("surface/coat.clh", features) + KERNEL
    text = layout.declarations(text, features) + text
    if mutant[0]:
        assert text.count(mutant[0]) == 1
        text = text.replace(*mutant)
    n = len(normals)
    nothing = np.zeros((n, 3))
    rows = [
        normals,
        faces,
        outs,
        nothing if given is None else given,
        nothing if xi is None else xi,
    ]
    arrays = [coat.record(), *(np.ascontiguousarray(row, np.float32) for row in rows)]
    return launch(device, text, "reflect", arrays, n, (3, 3, 1))


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def around(rng, axis, cosine):
    """Unit rows at a cosine of the axes (n, 3)."""
    beside = unit(np.cross(axis, rng.normal(size=axis.shape)))
    return cosine[:, None] * axis + np.sqrt(1.0 - cosine**2)[:, None] * beside


@pytest.mark.parametrize("name", COATS)
def test_the_table_holds_the_directional_albedo(name):
    """Between the nodes too, within 1e-3; another eta by 3 % is outside. So a white base under the
    coat reflects all light within 1e-3."""
    coat = COATS[name]
    nodes = np.linspace(0.0, 1.0, len(coat.albedos()))
    cosines = np.array([0.02, 0.08, 0.3, 0.5, 0.77, 0.95]) + 0.001
    found = np.interp(np.sqrt(cosines), nodes, coat.albedos())
    truth = np.array([Reference(coat).albedo(c) for c in cosines])
    assert np.abs(found - truth).max() < 1e-3
    other = Reference(Coat(1.03 * coat.eta, coat.roughness))
    assert max(abs(found - [other.albedo(c) for c in cosines])) > 1e-3


@pytest.mark.parametrize("name", COATS)
def test_a_white_base_reflects_what_the_coat_leaves(name):
    """The mean of the interpolated table by the cosine, by a fine midpoint rule."""
    coat = COATS[name]
    root = (np.arange(200_000) + 0.5) / 200_000
    albedo = np.interp(root, np.linspace(0.0, 1.0, len(coat.albedos())), coat.albedos())
    assert coat.mean_albedo() == pytest.approx(np.mean(4.0 * albedo * root**3), abs=1e-7)


def bent(rng, n):
    """Normals, faces and directions to the camera, all in front of each other."""
    faces = unit(rng.normal(size=(n, 3)))
    normals = around(rng, faces, rng.uniform(0.5, 1.0, n))
    outs = around(rng, normals, rng.uniform(0.02, 1.0, n))
    seen = dot(outs, faces) > 0.01
    return normals[seen], faces[seen], outs[seen]


@pytest.mark.parametrize("name", COATS)
def test_value_and_density_are_those_of_float64(device, rng, name):
    """Relative to the largest part, within 2e-4: what float32 leaves of sharp coats."""
    normals, faces, outs = bent(rng, 20_000)
    given = around(rng, normals, rng.uniform(-0.3, 1.0, len(normals)))
    given[::2] = unit(  # near the mirrored direction
        2.0 * dot(outs, normals)[:, None] * normals - outs + rng.normal(0, 0.1, outs.shape)
    )[::2]
    args = [np.asarray(a, np.float32).astype(np.float64) for a in (normals, faces, outs, given)]
    _, values, densities = reflect(device, COATS[name], *args)
    truth, density = Reference(COATS[name]).reflection(*args)
    sure = np.abs(dot(args[3], args[1])) > 1e-5
    assert density[sure].max() > 0.3
    assert np.abs(values - truth)[sure].max() < 2e-4 * truth.max()
    assert np.abs(densities - density)[sure].max() < 2e-4 * density.max()
    lit = sure & (density > 1e-3)
    assert np.abs(values[lit] / truth[lit] - 1.0).max() < 2e-3
    assert np.abs(densities[lit] / density[lit] - 1.0).max() < 2e-3


SAMPLE_MUTANTS = {
    "facets of another width": ("COAT_ALPHA], xi.xy);", "COAT_ALPHA] * 1.05f, xi.xy);"),
    "half the cap": ("1.0f + stretched.z, -stretched.z", "1.0f, 0.0f"),
    "another share": ("if (xi.z >= chance)", "if (xi.z >= 0.9f * chance)"),
}
CASES = [("skin", 0.3, 1.0), ("skin", 0.9, 0.7), ("rough", 0.15, 0.8), ("diamond", 0.5, 0.6)]


def p_of_samples(device, rng, case, mutant=("", "")):
    """By chi-square against the density of float64; what is lost is a cell of its own."""
    name, cosine, bend = case
    n = 200_000
    normal = np.array([0.0, 0.0, 1.0])
    face = np.array([np.sqrt(1.0 - bend**2), 0.0, bend])
    out = np.array([0.6 * np.sqrt(1.0 - cosine**2), 0.8 * np.sqrt(1.0 - cosine**2), cosine])
    rows = [np.broadcast_to(v, (n, 3)) for v in (normal, face, out)]
    directions, _, densities = reflect(
        device, COATS[name], *rows, xi=rng.random((n, 3)), mutant=mutant
    )
    bins = SphereBins(24, 32)
    reference = Reference(COATS[name])

    def density(at):
        return reflection_density(reference, normal, face, out, at)

    expected = n * bins.integrals(density, 12)
    counts = bins.counts(directions[densities > 0.0].astype(np.float64))
    lost = max(n - expected.sum(), 0.0)
    return chi_square_p(np.append(counts, n - counts.sum()), np.append(expected, lost))


def reflection_density(reference, normal, face, out, at):
    rows = [np.broadcast_to(v, at.shape) for v in (normal, face, out)]
    return reference.reflection(*rows, at)[1]


@pytest.mark.statistical
@pytest.mark.parametrize("case", CASES, ids=str)
def test_samples_have_their_density(device, rng, case):
    assert p_of_samples(device, rng, case) > sidak(len(CASES))


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", SAMPLE_MUTANTS)
def test_wrong_samples_are_seen(device, rng, mutant):
    assert p_of_samples(device, rng, CASES[0], SAMPLE_MUTANTS[mutant]) < sidak(len(CASES))


def white(tmp_path, light_sampling, roughness, **changes):
    """A white coated ball in white light."""
    scene = alone(ball(tmp_path, 2.0, 8), albedo=1.0, coat={"roughness": roughness}, **changes)
    return with_overrides(scene, [f"render.light_sampling={light_sampling}"])


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("light_sampling", "roughness", "spp"),
    [("bcsdf", 0.1, 1024), ("bcsdf", 0.4, 1024), ("mis", 0.3, 4096)],
)
def test_a_white_coated_mesh_disappears(device, tmp_path, light_sampling, roughness, spp):
    """The mean is 1 within 0.1 %; its standard error is below 0.04 %."""
    image = furcl.render(white(tmp_path, light_sampling, roughness, spp=spp), device=device)
    mean, error = mean_and_error(image)
    assert error < 4e-4
    assert abs(mean - 1.0) < 1e-3


PICTURE_MUTANTS = {
    "the base is not raised": (r"\* at->coat\[COAT_BASE\]", "", "bcsdf"),
    "light samples are not weighed": (r"towards = r\.pdf;", "towards = 1e-6f;", "mis"),
    "shared by the base alone": (r"r\.pdf = chance \* facets / masked \+", "r.pdf =", "bcsdf"),
}


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", PICTURE_MUTANTS)
def test_energy_that_is_lost_or_made_is_seen(device, tmp_path, monkeypatch, mutant):
    pattern, text, light_sampling = PICTURE_MUTANTS[mutant]
    substitute(monkeypatch, pattern, text, within="stages/shade_surface.cl")
    mean, _ = mean_and_error(
        furcl.render(white(tmp_path, light_sampling, 0.4, spp=512), device=device)
    )
    assert abs(mean - 1.0) > 5e-3


@pytest.mark.statistical
def test_light_samples_of_a_coat_change_no_mean(device, tmp_path):
    """Coloured, by a bright sun and by the sky alone; three channels within 4.5 errors (alpha
    2e-5)."""
    environment = {"kind": "sky", "sun_radius_deg": 20.0}
    coat = {"roughness": 0.3, "eta": 1.6}
    scene = alone(ball(tmp_path, 0.6, 6), environment, 12, 2048, albedo=[0.8, 0.4, 0.1], coat=coat)
    sampled, found = (
        furcl.render(with_overrides(scene, [f"render.light_sampling={word}"]), device=device)
        for word in ("mis", "bcsdf")
    )
    assert sampled.variance is not None
    assert found.variance is not None
    difference = sampled.rgb.sum(axis=(0, 1), dtype=np.float64) - found.rgb.sum(axis=(0, 1))
    error = np.sqrt((sampled.variance + found.variance).sum(axis=(0, 1), dtype=np.float64))
    assert (error < 0.01 * found.rgb.sum(axis=(0, 1))).all()
    assert (np.abs(difference) < 4.5 * error).all()


def test_without_a_coat_nothing_of_it_is_compiled(device, tmp_path):
    """And not uploaded. Texts: tests/test_features.py."""
    plain = Renderer(alone(ball(tmp_path, 1.0, 4)), device)
    coated = Renderer(alone(ball(tmp_path, 1.0, 4), coat={}), device)
    assert "mesh_coat" in plain.stats()["features"]["left_out"]
    assert "mesh_coat" not in coated.stats()["features"]["left_out"]
    sizes = [renderer.memory.bytes["mesh shading"] for renderer in (plain, coated)]
    assert sizes[1] - sizes[0] == 4 * (COAT_HEAD + COAT_NODES)
