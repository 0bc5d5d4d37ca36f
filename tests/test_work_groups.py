"""Work-groups of 1, 32, 64 and 256 items: every stage of a render, whatever a GPU prefers."""

import numpy as np
import pytest
from scene_documents import fur_patch

import furcl
from furcl.device import launch, program
from furcl.rendering import wavefront

SCENE = {"light_sampling": "mis", "residual": True, "spp": 2}


@pytest.fixture(autouse=True)
def fresh_programs():
    """Kernel objects keep the work-group size that they were compiled for on some runtimes."""
    program.forget_programs()
    yield
    program.forget_programs()


@pytest.mark.slow
@pytest.mark.parametrize("an_item", [1, 64])
@pytest.mark.parametrize("size", [1, 32, 64, 256])
def test_renders_agree(device, monkeypatch, size, an_item):
    """Pictures differ by rounding at most: a compiler may contract other sums for other sizes."""
    if size > device.cl_device.max_work_group_size:
        pytest.skip(f"{device.name} allows {device.cl_device.max_work_group_size} items a group")
    expected = furcl.render(fur_patch(**SCENE), device=device, wave_size=1000)
    monkeypatch.setattr(wavefront, "LOCAL_SIZE", size)
    for kind in ("CPU", "GPU"):
        monkeypatch.setattr(launch, f"_RAYS_{kind}", (an_item, min(an_item, 12), size))
        monkeypatch.setattr(launch, f"_PATHS_{kind}", (an_item, size))
    image = furcl.render(fur_patch(**SCENE), device=device, wave_size=1000)
    assert image.stats["rays"] == expected.stats["rays"]
    assert image.stats["nonfinite"] == 0
    np.testing.assert_allclose(image.rgb, expected.rgb, rtol=1e-4, atol=1e-5)
