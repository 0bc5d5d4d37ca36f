"""From a scene to the `Features` of its kernels, with the reason for everything left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from furcl.device.features import Features
from furcl.device.layout import LAYERS
from furcl.errors import SceneError
from furcl.fibre.material import NEGLIGIBLE_SHARE, FibreMaterial
from furcl.fibre.model import model_of
from furcl.light.lamps.layout import LampsPart
from furcl.light.lights import Lights
from furcl.rendering.layers import LayerPart
from furcl.rendering.learning import LearningPart
from furcl.scene.tables import Scene
from furcl.settings import switched_on
from furcl.surface.kinds import ABSENT
from furcl.surface.mesh.mesh import EVERY_MESH, Meshes


def scene_features(
    scene: Scene,
    fibres: Sequence[Any],
    lights: Lights,
    meshes: Meshes | None = None,
    with_target: bool = False,
    grey_strands: bool = True,
) -> Features:
    """What the kernels of a scene, with what is built from it, need, whatever the grooms are.

    The light is sampled (MIS) where `light_sampling` says so, and by "auto" unless every direction
    is worth the same. Adaptive allocation and target errors need plans. With FURCL_DEBUG=1 in the
    environment kernels check their indices. `grey_strands`: whether the absorptions of strands and
    points, where they differ, are grey.

    Raises
    ------
    SceneError      light_sampling = "bcsdf" with a light that only light samples can find; a plan
                    without variance
    """
    render = scene.render
    planned = with_target or render.allocation == "adaptive"
    if planned and not render.variance:
        wants = "a target error" if with_target else "render.allocation = 'adaptive'"
        raise SceneError(
            f"scene {scene.name!r}: render.variance = false: {wants} needs the variance; set it to "
            f"true or leave it out"
        )
    if render.light_sampling == "bcsdf" and lights.hidden:
        raise SceneError(
            f"scene {scene.name!r}: render.light_sampling = 'bcsdf' never finds a light of kind "
            f"{lights.hidden[0]!r}; allowed are 'mis' and 'auto'"
        )
    light_sampling = render.light_sampling == "mis" or (
        render.light_sampling == "auto" and lights.worth_sampling
    )
    grey = grey_strands and all(model_of(fibre).is_grey(fibre) for fibre in fibres) and lights.grey
    grey = grey and (scene.body is None or scene.body.is_grey)
    grey = grey and (meshes is None or meshes.is_grey)
    adjoint = render.roulette == "adjoint"
    return Features(
        learning=LearningPart() if adjoint else None,
        layers=_layers(scene, fibres),
        transparent=scene.film.background == "transparent",
        light=lights.environment_part,
        lamps=lights.lamps_part,
        surface=scene.body.part if scene.body is not None else None,
        fibres=len(fibres),
        meshes=meshes.part if meshes is not None else None,
        channels=1 if grey else 3,
        light_sampling=light_sampling,
        lens=scene.chosen_camera.aperture_radius > 0.0,
        orthographic=scene.chosen_camera.orthographic,
        camera_motion=len(scene.chosen_camera.places) - 1,
        crop=scene.film.crop is not None,
        filter=scene.film.filter,
        sequence=render.sequence,
        roulette=render.first_roulette < render.max_depth,
        shadow_roulette=light_sampling and (adjoint or render.shadow_threshold > 0.0),
        variance=render.variance or adjoint,
        planned=planned,
        statistics=render.statistics,
        debug=switched_on("FURCL_DEBUG"),
    )


def _layers(scene: Scene, fibres: Sequence[Any]) -> LayerPart | None:
    """The layers of the film; transparency wants alpha."""
    wanted = {*scene.film.layers, *(["alpha"] if scene.film.background == "transparent" else [])}
    if not wanted:
        return None
    lobes: dict[str, None] = {}
    for fibre in fibres if "lobes" in wanted else ():
        model = model_of(fibre)
        n_lobes = model.features(fibre, residual=scene.render.residual).n_lobes
        lobes |= dict.fromkeys(lobe.name for lobe in model.lobes[:n_lobes])
    return LayerPart(tuple(name for name in LAYERS if name in wanted), tuple(lobes))


def everything_on(features: Features) -> Features:
    """The same expected picture from kernels with all the code that some scene could need.

    What chooses another picture or the subject of a comparison stays as it is: fibre model, light,
    projection, pixel filter. The light is sampled always.
    """
    return features.with_(
        channels=3,
        light_sampling=True,
        point_radii=True,
        lamps=features.lamps.everything_on() if isinstance(features.lamps, LampsPart) else None,
        surface=features.surface or ABSENT.part,
        meshes=features.meshes and EVERY_MESH,
        lens=True,
        crop=True,
        roulette=True,
        shadow_roulette=True,
        variance=True,
        planned=True,
        statistics=True,
    )


def _parts(material: FibreMaterial) -> dict[str, tuple[bool, str]]:
    """Feature -> whether a build has it, and why it might not."""
    features = material.features
    meshes = features.meshes.as_dict() if features.meshes is not None else {}
    of_meshes = {
        "mesh_normals": "no mesh is smooth",
        "mesh_textures": "no mesh has a texture",
        "mesh_emission": "no mesh emits light",
        "mesh_coat": "no mesh has a coat",
    }
    tables = material.tables is not None
    return {
        **material.fibre_features.optional(),
        "colour": (features.channels == 3, "fibres, light and surfaces are grey: one channel"),
        "offsets": (features.mode != "far", "mode is far: a fibre shows the mean of its width"),
        "light_sampling": (features.light_sampling, "the light is not sampled"),
        "point_radii": (features.point_radii, "all points have one radius: 12 bytes a vertex"),
        "body": (features.surface is not None, "the scene has no body"),
        "meshes": (features.meshes is not None, "the scene has no meshes"),
        **{name: (bool(meshes.get(name)), reason) for name, reason in of_meshes.items()},
        "environment": (features.light is not None, "the scene has no environment"),
        "lamps": (features.lamps is not None, "the scene has no lamps"),
        "orthographic": (features.orthographic, "the camera has a perspective"),
        "transparent": (features.transparent, "the light behind the scene is seen"),
        "layers": (features.layers is not None, "film.layers asks for none"),
        "crop": (features.crop, "the film holds the whole picture"),
        "motion": (features.motion > 0, "no groom moves while the shutter is open"),
        "camera_motion": (features.camera_motion > 0, "the camera keeps still"),
        "lens": (features.lens, "aperture_radius is 0: pinhole"),
        "sobol": (features.sequence == "sobol", "samples of a pixel are independent"),
        "roulette": (features.roulette, "roulette_depth is not below max_depth"),
        "shadow_roulette": (features.shadow_roulette, "every light sample is tested"),
        "learning": (features.learning is not None, "roulette is not adjoint: nothing is learned"),
        "tables": (tables, "the sampler needs no attenuation tables"),
        "variance": (features.variance, "no variance was asked for"),
        "held": (features.held, "no samples share numbers"),
        "planned": (features.planned, "all pixels take the same number of samples"),
        "statistics": (features.statistics, "no statistics were asked for"),
        "debug": (features.debug, "FURCL_DEBUG is not set"),
    }


def compiled_in(material: FibreMaterial) -> list[str]:
    """What the kernels have of all that can be left out: features, then lobes."""
    parts = [name for name, (there, _) in _parts(material).items() if there]
    return [*parts, *(f"lobe {name}" for name in material.fibre_features.lobes)]


def left_out(material: FibreMaterial) -> dict[str, str]:
    """What the kernels do without, and why: feature -> reason."""
    absent = {name: reason for name, (there, reason) in _parts(material).items() if not there}
    for lobe in material.fibre_features.dropped_lobes:
        absent[f"lobe {lobe}"] = f"less than {NEGLIGIBLE_SHARE:g} of the energy at every theta"
    return absent


def summary(material: FibreMaterial, device_bytes: int, compile_seconds: float) -> str:
    """One line for the log: what is in, what is left out, and what it took."""
    return (
        f"compiled in: {', '.join(compiled_in(material))}; left out: "
        f"{', '.join(left_out(material)) or 'nothing'}; {device_bytes / 2**20:.1f} MiB on the "
        f"device, compiled in {compile_seconds:.2f} s"
    )
