"""What a scene needs of an OpenCL device, and what its fibre does there, for people."""

from __future__ import annotations

import time

from furcl.bvh import build
from furcl.device.choice import Device
from furcl.fibre.double_cylinder import reference
from furcl.fibre.double_cylinder.paper import LOBE_SHARES
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles, build_profiles
from furcl.render.renderer import Renderer
from furcl.render.specialise import compiled_in, left_out
from furcl.scene.tables import Scene

_TABLES = ("material",)
_FILM = ("film", "film samples", "nonfinite")


def describe(scene: Scene, device: str | Device | None = None) -> dict[str, str]:
    """Lobe shares, medulla tables, features and memory of a scene on a device.

    Sets a render up to its first sample, so that nothing here is an estimate. The medulla's
    profiles are simulated anew to time that: seconds, unless the fibre has none.

    Parameters
    ----------
    scene : Scene
    device : str, Device or None    as for `furcl.render`

    Raises
    ------
    DeviceError, GroomError, SceneError, ResourceError, KernelBuildError
    """
    renderer = Renderer(scene, device)
    opened, fibre = renderer.device, scene.build_fibre()
    cold, warm, profiles = _timed_profiles(opened, fibre)
    return {
        "device": f"{opened.name}, {opened.platform}, driver {opened.driver_version}",
        **_describe_shares(fibre, profiles),
        "medulla tables": _describe_tables(profiles, cold, warm),
        "compiled in": ", ".join(compiled_in(renderer.material)),
        **{f"no {name}": why for name, why in left_out(renderer.material).items()},
        **_describe_memory(renderer.memory.bytes),
        "set-up": ", ".join(f"{name} {t:.2f} s" for name, t in renderer.seconds.items()),
    }


def _timed_profiles(device: Device, fibre: Fibre) -> tuple[float, float, MedullaProfiles | None]:
    """Seconds to simulate the profiles, seconds to load them, and the profiles."""
    start = time.perf_counter()
    build_profiles(device, fibre, cache=False)
    middle = time.perf_counter()
    profiles = build_profiles(device, fibre)
    return middle - start, time.perf_counter() - middle, profiles


def _describe_shares(fibre: Fibre, profiles: MedullaProfiles | None) -> dict[str, str]:
    """Shares of the lobes over isotropic fibres; beside them the paper's for its three fibres."""
    ours = reference.lobe_shares(fibre, profiles)
    lines = {"lobe shares": _percentages([100.0 * ours[lobe] for lobe in reference.LOBES])}
    for name, shares in LOBE_SHARES.items():
        if Fibre.preset(name) == fibre:
            lines["shares in the paper"] = _percentages(shares)
    return lines


def _percentages(shares: list[float] | tuple[float, ...]) -> str:
    return ", ".join(
        f"{lobe} {share:.3g} %" for lobe, share in zip(reference.LOBES, shares, strict=True)
    )


def _describe_tables(profiles: MedullaProfiles | None, cold: float, warm: float) -> str:
    if profiles is None:
        return "none: the medulla scatters nothing"
    return (
        f"{profiles.pack().nbytes / 1e3:.0f} kB, largest relative standard error "
        f"{profiles.relative_error:.2%}, {profiles.photons / 1e6:.1f} million photons, "
        f"{cold:.2f} s to simulate, {1e3 * warm:.0f} ms from the cache"
    )


def _describe_memory(held: dict[str, int]) -> dict[str, str]:
    groups = {"geometry": build.BUFFERS, "tables": _TABLES, "film": _FILM}
    sizes = {name: sum(held[part] for part in parts) for name, parts in groups.items()}
    sizes["environment"] = held["light"]
    sizes["path state"] = sum(held.values()) - sum(sizes.values())
    parts = ", ".join(f"{name} {size / 2**20:.2f}" for name, size in sizes.items())
    return {"device memory": f"{sum(held.values()) / 2**20:.2f} MiB: {parts}"}
