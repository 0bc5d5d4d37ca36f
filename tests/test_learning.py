"""What is learned while rendering changes no mean, and no bit by how the work is cut."""

from scene_documents import fur_patch

import furcl
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides

ADJOINT = {"roulette": "adjoint", "light_sampling": "mis"}


def _bits(image):
    return image.rgb.tobytes(), image.variance.tobytes()


def _scene(**render):
    return with_overrides(
        fur_patch({"preset": "white"}, **ADJOINT | render), ["curves.n_strands=1000"]
    )


def test_wave_size_changes_no_bit(device):
    """Waves end where something is learned, whatever their size; so do rays and lobes agree."""
    images = [
        furcl.render(_scene(spp=24), device=device, wave_size=n) for n in (1 << 18, 1000, 100)
    ]
    assert _bits(images[0]) == _bits(images[1]) == _bits(images[2])
    assert images[0].stats["rays"] == images[1].stats["rays"] == images[2].stats["rays"]
    unlearned = furcl.render(_scene(spp=24, roulette="throughput"), device=device)
    assert _bits(unlearned) != _bits(images[0])


def test_a_render_cut_in_pieces_is_the_same(device):
    renderer = Renderer(_scene(), device, wave_size=700)
    for spp in (1, 4, 1, 18):
        assert renderer.advance(spp)
    assert _bits(renderer.image()) == _bits(furcl.render(_scene(spp=24), device=device))


def test_a_render_that_is_stopped_goes_on_the_same(device):
    """After the first sample, before anything is learned, and in the middle of learning."""
    renderer = Renderer(_scene(), device, wave_size=24 * 16)
    for already in (1, 2, 3):
        assert not renderer.advance(20, progress=lambda done, of: True)
        assert renderer.samples_done == already
    renderer.advance(21)
    assert _bits(renderer.image()) == _bits(furcl.render(_scene(spp=24), device=device))


def test_a_restart_forgets(device):
    renderer = Renderer(_scene(), device)
    renderer.advance(24)
    renderer.restart(5)
    renderer.advance(24)
    assert _bits(renderer.image()) == _bits(furcl.render(_scene(spp=24), seed=5, device=device))
