"""Facts about scenes and grooms: what is promised is there, and it is true."""

import logging
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_files import obj_text
from mesh_shapes import sphere
from scene_documents import fur_patch, minimal

import furcl
import furcl.cli
from furcl.cli import facts as cli_facts
from furcl.cli import warnings
from furcl.cli.facts import of_scene, on_device
from furcl.device.choice import Device
from furcl.errors import NoDeviceError
from furcl.fibre.double_cylinder import profiles
from furcl.fibre.double_cylinder.paper import LOBE_SHARES
from furcl.groom.curves import Curves
from furcl.groom.formats import save_curves
from furcl.image.image import Image
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene, load_scene, with_overrides
from furcl.scene.tables import Scene

SCENE = """
[fibre]
preset = "raccoon"
sigma_ca = [0.1, 0.2, 0.1]
[environment]
kind = "image"
file = "light.exr"
[curves]
file = "groom.npz"
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    points = np.array([[0, 0, 0], [0, 0, 1], [0, 0.5, 2]], np.float32)
    save_curves(Curves.from_arrays(points, 0.05, [0, 3]), tmp_path / "groom.npz")
    light = np.ones((4, 8, 3), np.float32)
    light[1, 2], light[3, 5, 0] = -1.0, -0.5
    Image(light).save(tmp_path / "light.exr")
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def test_scene(scene: Path) -> None:
    facts = of_scene(load_scene(scene))
    assert "sigma_ca 0.1/0.2/0.1," in facts["fibre"]
    assert "sigma_ma 0.2, g 0.4, layers 0.736" in facts["fibre"]
    assert facts["fibre's source"].startswith("fitted: ")
    assert facts["fibre's source"].endswith("changed: sigma_ca")
    assert facts["environment"].endswith("2 pixels below zero set to zero")
    assert facts["segments"] == "2"


def test_groom_needs_no_opencl(scene: Path) -> None:
    groom = scene.with_name("groom.npz")
    code = (
        "import sys; sys.modules['pyopencl'] = None; from furcl.cli import main; "
        f"main(['info', {str(groom)!r}])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "segments             2\n" in done.stdout


def _facts(device: Device, *overrides: str) -> tuple[Scene, dict[str, str]]:
    scene = with_overrides(fur_patch(), overrides)
    return scene, on_device(scene, device)


def test_fibre_of_the_paper(device: Device) -> None:
    _, facts = _facts(device, "fibre.preset=human-white")
    assert facts["shares in the paper"] == "R 12.7 %, TT 34 %, TRT 1.11 %, TTs 50.5 %, TRTs 1.73 %"
    ours = [float(part.split()[1]) for part in facts["lobe shares"].split(", ")]
    assert sum(ours) == pytest.approx(100.0, abs=0.1)
    assert ours == pytest.approx(LOBE_SHARES["human-white"], abs=2.0)
    assert re.match(r"\d+ kB, largest relative standard error 1\.", facts["medulla tables"])
    assert "TRTs" in facts["compiled in"]
    assert facts["no lens"] == "aperture_radius is 0: pinhole"
    assert facts["no profile_channels"] == "sigma_ma is 0: no medulla absorption"


def test_a_medulla_is_simulated_once(
    device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For the render, which keeps it; not again to tell of it."""
    runs = []
    simulate = profiles.simulate
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(profiles, "simulate", lambda *a: (runs.append(a), simulate(*a))[1])
    for _ in range(2):
        _, facts = _facts(device, "fibre.preset=human-white")
        assert "million photons" in facts["medulla tables"]
        assert len(runs) == 1


def test_fibre_without_medulla(device: Device) -> None:
    scene, facts = _facts(device, "fibre.kappa=0.0")
    assert "shares in the paper" not in facts
    assert facts["medulla tables"] == "none: the medulla scatters nothing"
    assert "TTs 0 %, TRTs 0 %" in facts["lobe shares"]
    assert "TTs" in facts["no scattered"]
    assert "lobe TTs" not in facts["compiled in"]
    held = Renderer(scene, device).memory.total_bytes / 2**20
    total, parts = facts["device memory"].split(" MiB: ")
    assert float(total) == pytest.approx(held, abs=0.01)
    sizes = [float(part.rsplit(" ", 1)[1]) for part in parts.split(", ")]
    assert sum(sizes) == pytest.approx(held, abs=0.05)
    assert "compile " in facts["set-up"]


def test_without_a_device(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What can be told without one is told, and that there is none."""

    def no_device(*_: object) -> dict[str, str]:
        raise NoDeviceError("no OpenCL device: none")

    monkeypatch.setattr(cli_facts, "on_device", no_device)
    with pytest.raises(SystemExit) as ended:
        furcl.cli.main(["info", str(scene)])
    assert not ended.value.code
    text = capsys.readouterr().out
    assert "device               none, so what the scene needs of it is not known: " in text
    assert "segments             2\n" in text


def test_render_logs_its_features(device: Device, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "furcl"):
        furcl.render(fur_patch(spp=1), device=device)
    lines = [record.getMessage() for record in caplog.records]
    (line,) = [line for line in lines if line.startswith("compiled in: ")]
    before, after = line.split("; left out: ")
    assert "lobe TTs" in before
    assert "residual" in after
    assert "residual" not in before
    assert " MiB on the device, compiled in " in after


@pytest.mark.parametrize(
    ("height", "said"), [(0.0, False), (-1.02, False), (-30.0, True)], ids=["in", "floor", "far"]
)
def test_a_mesh_far_beside_the_groom_is_told(tmp_path, height, said):
    """A ball within the fur, one just below it like a floor, one in other units."""
    (tmp_path / "ball.obj").write_text(obj_text(sphere(8, 1.0).corners))
    scene = decode_scene(
        minimal(
            curves={"generator": "fur", "n_strands": 200, "length": 0.1},
            mesh={
                "ball": {
                    "file": str(tmp_path / "ball.obj"),
                    "transform": {"translate": [0.0, 0.0, 2.0 * height]},
                }
            },
        )
    )
    told = list(warnings.of_scene(scene, scene.build_curves(), scene.build_meshes()))
    assert any("beside each other" in text for text in told) == said


@pytest.mark.parametrize(
    ("fibre", "black"),
    [
        ({"preset": "human-black"}, False),
        ({"model": "chiang", "sigma_a": 1e4}, False),
        ({"model": "chiang", "sigma_a": 1e4, "eta": 1.0001}, True),
        ({"model": "chiang", "sigma_a": [0.1, 1e4, 1e4], "eta": 1.0001}, False),
        ({"preset": "human-black", "sigma_ca": 1e3, "eta": 1.01}, True),
    ],
)
def test_a_black_fibre_is_told(fibre, black):
    scene = decode_scene(minimal(fibre=fibre))
    told = list(warnings.of_scene(scene, scene.build_curves()))
    assert any("it is black" in text for text in told) == black


@pytest.mark.parametrize(
    ("curves", "camera", "part"),
    [
        ({"radius": 0.02}, {}, None),
        ({"radius": 0.6}, {}, "are radii in other units"),
        ({}, {"aperture_radius": 0.5}, None),
        ({}, {"aperture_radius": 3000.0}, "reduce aperture_radius"),
    ],
    ids=["thick", "other units", "a lens", "a lens in other units"],
)
def test_what_hides_a_groom_is_told(curves, camera, part):
    fur = {"generator": "fur", "n_strands": 300, "length": 0.3, "radius": 1e-3}
    scene = decode_scene(minimal(curves={**fur, **curves}, camera=camera))
    told = list(warnings.of_scene(scene, scene.build_curves()))
    assert len(told) == (part is not None)
    assert all(part in text for text in told)
