"""Debug builds: index checks that change no picture and report what is out of range."""

import numpy as np
import pyopencl as cl
import pytest
from scene_documents import fur_patch

from furcl import layout
from furcl.errors import KernelIndexError
from furcl.integrator import Renderer


@pytest.fixture
def renderer(device, monkeypatch):
    monkeypatch.setenv("FURCL_DEBUG", "1")
    return Renderer(fur_patch(light_sampling="mis", spp=4), device)


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
    wave = renderer._next_wave(renderer.n_pixels)
    return wave, renderer.wavefront.generate(wave)


def test_a_corrupted_queue_is_reported(renderer):
    wave, active = _generate(renderer)
    stages = renderer.wavefront
    bad = np.array([4_000_000_000], np.uint32)
    cl.enqueue_copy(stages.queue, stages.active, bad, dst_offset=4 * 17)
    size = int(wave["n_slots"])
    with pytest.raises(
        KernelIndexError,
        match=rf"kernel intersect_closest, intersect.cl:\d+: index 4000000000 .* below {size} ",
    ):
        stages.intersect_closest(wave, active)
    # The record is empty again.
    _, active = _generate(renderer)
    stages.intersect_closest(wave, active)


def test_a_segment_that_does_not_exist_is_reported(renderer):
    wave, active = _generate(renderer)
    stages = renderer.wavefront
    stages.intersect_closest(wave, active)
    plane = layout.planes(renderer.features).index("HIT_SEGMENT")
    segments = np.full(int(wave["n_slots"]), 123_456_789, np.uint32)
    cl.enqueue_copy(stages.queue, stages.state, segments, dst_offset=4 * plane * len(segments))
    with pytest.raises(KernelIndexError, match=r"sample_lobe_h, sample_lobe_h.cl:\d+: index 12345"):
        stages.sample_lobe_h(wave, active, 0)
