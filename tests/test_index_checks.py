"""Debug builds: index checks that change no picture and report what is out of range."""

import re
import shutil

import msgspec
import numpy as np
import pyopencl as cl
import pytest
from scene_documents import fur_patch

from furcl.bench.features import preprocessed
from furcl.device import layout, source
from furcl.errors import KernelIndexError
from furcl.image.exr import write_exr
from furcl.light.image import ImageEnvironment
from furcl.rendering.renderer import Renderer


@pytest.fixture
def renderer(device, monkeypatch):
    monkeypatch.setenv("FURCL_DEBUG", "1")
    return Renderer(fur_patch(light_sampling="mis", spp=4), device)


@pytest.fixture
def light_picture(tmp_path):
    """The scene in the light of a picture of 8 x 4 texels."""
    pixels = np.random.default_rng(1).random((4, 8, 3)).astype(np.float32)
    write_exr(tmp_path / "light.exr", {c: pixels[..., i] for i, c in enumerate("RGB")}, {})
    scene = fur_patch(light_sampling="mis", spp=1)
    return msgspec.structs.replace(
        scene, environment=ImageEnvironment(file=str(tmp_path / "light.exr"))
    )


def test_a_debug_render_is_the_same_picture(device, renderer, monkeypatch):
    assert renderer.features.debug
    renderer.advance(4)
    monkeypatch.setenv("FURCL_DEBUG", "0")
    plain = Renderer(fur_patch(light_sampling="mis", spp=4), device)
    assert not plain.features.debug
    plain.advance(4)
    np.testing.assert_allclose(renderer.image().rgb, plain.image().rgb, rtol=1e-4, atol=1e-5)


def _generate(renderer):
    """A wave up to its camera rays."""
    wave, _ = renderer._next_wave(renderer.n_pixels)
    return wave, renderer.wavefront.generate(wave)


def test_a_corrupted_queue_is_reported(renderer):
    wave, active = _generate(renderer)
    stages = renderer.wavefront
    bad = np.array([4_000_000_000], np.uint32)
    cl.enqueue_copy(stages.queue, stages.active, bad, dst_offset=4 * 17)
    found = rf"kernel intersect_closest, core/paths.clh:\d+: index 4000000000 .* {stages.n_slots} "
    with pytest.raises(KernelIndexError, match=found):
        stages.intersect_closest(wave, active)
    # The record is empty again.
    _, active = _generate(renderer)
    stages.intersect_closest(wave, active)


def test_a_segment_that_does_not_exist_is_reported(renderer):
    wave, active = _generate(renderer)
    stages = renderer.wavefront
    stages.intersect_closest(wave, active)
    names = layout.planes(renderer.features)
    blocks = int(wave["n_slots"]) // layout.STATE_BLOCK
    words = np.empty((blocks, len(names), layout.STATE_BLOCK), np.uint32)
    cl.enqueue_copy(stages.queue, words, stages.state)
    words[:, names.index("HIT_SEGMENT")] = 123_456_789
    cl.enqueue_copy(stages.queue, stages.state, words)
    with pytest.raises(
        KernelIndexError, match=r"sample_lobe_h, geometry/fibre_hits.clh:\d+: index 12345"
    ):
        stages.sample_lobe_h(stages.fibres[0], wave, active, 0)


@pytest.mark.parametrize("kind", ["subtree", "segment"])
def test_a_broken_tree_is_reported(renderer, kind):
    """References of blocks that lead nowhere; a ray that follows one goes on elsewhere."""
    wave, active = _generate(renderer)
    stages = renderer.wavefront
    words = np.empty(stages.geometry[0].size // 4, np.uint32)
    cl.enqueue_copy(stages.queue, words, stages.geometry[0])
    blocks = words[: -layout.CHECK_WORDS].reshape(-1, layout.BLOCK_WORDS)[:-1]
    are_segments = (blocks[:, layout.BLOCK_LANES, None] >> (8 + np.arange(8))) & 1 == (
        kind == "segment"
    )
    in_use = (blocks[:, layout.BLOCK_LANES, None] >> np.arange(8)) & 1 == 1
    assert (are_segments & in_use).any()
    blocks[:, layout.BLOCK_REFERENCES :][are_segments & in_use] = 23_456_789
    cl.enqueue_copy(stages.queue, stages.geometry[0], words)
    size = len(blocks) if kind == "subtree" else stages.n_vertices - 1
    with pytest.raises(
        KernelIndexError,
        match=rf"kernel intersect_closest, bvh/block.clh:\d+: index 23456789 .* below {size} ",
    ):
        stages.intersect_closest(wave, active)


# File, what is wrong in it, what replaces it; the kernel that finds it and the text of its line.
MUTANTS = {
    "row of the tables": (
        "include/fibre/rows.clh", "(FURCL_TABLE_ROWS - 1), FURCL_TABLE_ROWS)", "2e3f, 2000)",
        "marginal_densities", "include/fibre/rows.clh",
        "fibre_record(fibre), at.row, FURCL_TABLE_ROWS - 1)",
    ),
    "row of the marginal densities": (
        "include/fibre/sampler.clh", "rows.theta.node * FURCL_MARGINAL_PHIS +",
        "(rows.theta.node + 99u) * FURCL_MARGINAL_PHIS +",
        "shade", "include/fibre/sampler.clh", "fibre_record(fibre), node, n_nodes)",
    ),
    "bin of the profiles": (
        "include/fibre/double_cylinder/profiles.clh",
        "return min((uint)fmax(", "return 128u + min((uint)fmax(",
        "marginal_densities", "include/fibre/double_cylinder/profiles.clh",
        "fibre, profile_phi_bin(",
    ),
    "row of the profiles": (
        "include/fibre/double_cylinder/profiles.clh",
        "= tau.node * FURCL", "= (tau.node + 4u) * FURCL",
        "attenuation_bins", "include/fibre/double_cylinder/profiles.clh",
        "PROFILE_ESCAPE + PROFILE_INDEX(fibre, r->row[i]",
    ),
    "texel of the light": (
        "include/light/image.clh", "clamp((int)y0, 0, height - 1)", "(int)y0 + height",
        "shade_escaped", "include/light/image.clh", "top, height)",
    ),
    "sum of the film": (
        "stages/film.cl", "(pixel * FILM_SPECTRA", "(9999u + pixel * FILM_SPECTRA",
        "add_to_film", "stages/film.cl", "return film + FURCL_INDEX(",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_index_is_reported(device, tmp_path, monkeypatch, light_picture, name):
    """Mutants of the kernels: each is found by the kernel and in the line that uses the index."""
    file, right, wrong, kernel, found_in, line_text = MUTANTS[name]
    folder = tmp_path / "kernels"
    shutil.copytree(source.kernel_folder(), folder)
    text = (folder / file).read_text()
    assert text.count(right) == 1
    (folder / file).write_text(text.replace(right, wrong))
    lines = (folder / found_in).read_text().splitlines()
    (line,) = (i for i, text in enumerate(lines, 1) if line_text in text)
    label = found_in.removeprefix("include/")
    monkeypatch.setenv("FURCL_DEBUG", "1")
    monkeypatch.setattr(source, "kernel_folder", lambda: folder)
    with pytest.raises(KernelIndexError, match=rf"kernel {kernel}, {label}:{line}: index"):
        Renderer(light_picture, device).advance(1)


def test_release_builds_hold_no_checks(device, light_picture, monkeypatch):
    """Nothing of them is left in what the compiler sees; a debug build holds them."""
    found = {}
    for debug in ("0", "1"):
        monkeypatch.setenv("FURCL_DEBUG", debug)
        texts = Renderer(light_picture, device).wavefront.texts()
        seen = "\n".join(preprocessed(text) for text in texts)
        found[debug] = len(re.findall(r"checked_index|recorded?\(|CHECK|FURCL_", seen))
    assert found["0"] == 0
    # Measured: 95.
    assert found["1"] > 50
