"""From a scene to the `Features` of its kernels, with the reason for everything left out."""

from __future__ import annotations

from furcl.device.features import Features
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.material import NEGLIGIBLE_SHARE, fibre_features
from furcl.light.environment import ConstantLight, Environment
from furcl.scene.tables import Scene
from furcl.settings import switched_on
from furcl.table import triple


def scene_features(scene: Scene, fibre: Fibre, environment: Environment) -> Features:
    """What the kernels of a scene, with what is built from it, need, whatever the groom is.

    The environment is sampled (MIS) where `light_sampling` says so, and by "auto" unless it is
    constant: then every direction is worth the same and sampling it gains nothing. With
    FURCL_DEBUG=1 in the environment kernels check their indices.
    """
    render = scene.render
    light_sampling = render.light_sampling == "mis" or (
        render.light_sampling == "auto" and environment.kind != "constant"
    )
    features = fibre_features(fibre, sampling=render.sampling, residual=render.residual)
    grey = features.channels == 1 and _is_grey(scene, environment)
    return features.with_(
        channels=1 if grey else 3,
        environment=environment.kind,
        light_sampling=light_sampling,
        body=scene.body is not None,
        lens=scene.camera.aperture_radius > 0.0,
        filter=scene.film.filter,
        roulette=render.roulette_depth < render.max_depth,
        variance=render.variance,
        statistics=render.statistics,
        debug=switched_on("FURCL_DEBUG"),
    )


def everything_on(features: Features) -> Features:
    """The same expected picture from kernels with all the code that some scene could need.

    What chooses another picture or the subject of a comparison stays as it is: sampler,
    environment, pixel filter and the residual lobe. The environment is sampled always.
    """
    return features.with_(
        channels=3,
        medulla=True,
        scattered=True,
        profile_channels=3,
        layered=True,
        tilt=True,
        dropped_lobes=(),
        light_sampling=True,
        point_radii=True,
        body=True,
        lens=True,
        roulette=True,
        variance=True,
        statistics=True,
    )


def _is_grey(scene: Scene, environment: Environment) -> bool:
    light = isinstance(environment, ConstantLight) and len(set(environment.value.tolist())) == 1
    body = scene.body is None or len(set(triple(scene.body.albedo))) == 1
    return light and body


def _parts(features: Features) -> dict[str, tuple[bool, str]]:
    """Feature -> whether a build has it, and why it might not."""
    return {
        "medulla": (features.medulla, "kappa is 0, or nothing absorbs or scatters"),
        "scattered": (features.scattered, "kappa or sigma_ms is 0: lobes TTs and TRTs, profiles"),
        "profile_channels": (features.profile_channels > 0, "sigma_ma is 0: no medulla absorption"),
        "layered": (features.layered, "layers is 1/2: the cuticle is a plain interface"),
        "tilt": (features.tilt, "alpha is 0"),
        "residual": (features.residual, "render.residual is false: lobe TRRT+"),
        "colour": (features.channels == 3, "fibre, light and body are grey: one channel"),
        "light_sampling": (features.light_sampling, "the environment is not sampled"),
        "point_radii": (features.point_radii, "all points have one radius: 12 bytes a vertex"),
        "body": (features.body, "the scene has no body"),
        "lens": (features.lens, "aperture_radius is 0: pinhole"),
        "roulette": (features.roulette, "roulette_depth is not below max_depth"),
        "tables": (features.sampler.needs_tables, "the sampler needs no attenuation tables"),
        "variance": (features.variance, "no variance was asked for"),
        "statistics": (features.statistics, "no statistics were asked for"),
        "debug": (features.debug, "FURCL_DEBUG is not set"),
    }


def compiled_in(features: Features) -> list[str]:
    """What a build has of all that can be left out: features, then lobes."""
    parts = [name for name, (there, _) in _parts(features).items() if there]
    return [*parts, *(f"lobe {name}" for name in features.lobes)]


def left_out(features: Features) -> dict[str, str]:
    """What a build does without, and why: feature -> reason."""
    absent = {name: reason for name, (there, reason) in _parts(features).items() if not there}
    for lobe in features.dropped_lobes:
        absent[f"lobe {lobe}"] = f"less than {NEGLIGIBLE_SHARE:g} of the energy at every theta"
    return absent


def summary(features: Features, device_bytes: int, compile_seconds: float) -> str:
    """One line for the log: what is in, what is left out, and what it took."""
    return (
        f"compiled in: {', '.join(compiled_in(features))}; left out: "
        f"{', '.join(left_out(features)) or 'nothing'}; {device_bytes / 2**20:.1f} MiB on the "
        f"device, compiled in {compile_seconds:.2f} s"
    )
