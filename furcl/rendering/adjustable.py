"""A renderer that takes another camera, other fibres and other windows of its film in a moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec

from furcl.device.choice import Device
from furcl.errors import ResourceError, SceneError
from furcl.light.lights import Lights
from furcl.rendering.arguments import Given
from furcl.rendering.renderer import Renderer
from furcl.rendering.setup import (
    Geometry,
    scene_material,
    surface_struct,
    upload_lights,
    wave_struct,
)
from furcl.rendering.specialise import scene_features
from furcl.scene.tables import Film, Scene


class AdjustableRenderer(Renderer):
    """A renderer for a scene that is being worked on: trees, kernels and buffers stay.

    Its kernels have all that fibres of the scene's models and windows of its film could need, so
    they are slower than those of `Renderer` by what `furcl bench features` says; the picture is
    another estimate of the same one.

    Parameters
    ----------
    scene : Scene               without layers; every pixel takes the same number of samples
    device, wave_size, curves, geometry     as for `Renderer`

    Raises
    ------
    DeviceError, GroomError, SceneError, ResourceError, KernelBuildError
    """

    def __init__(
        self,
        scene: Scene,
        device: str | Device | None = None,
        wave_size: int | None = None,
        curves: Given = None,
        geometry: Geometry | None = None,
    ) -> None:
        if scene.film.layers or scene.film.background != "light":
            raise SceneError(
                f"scene {scene.name!r}: a picture of changing size has no layers; leave out "
                f"film.layers and film.background"
            )
        if scene.render.allocation != "even":
            raise SceneError(
                f"scene {scene.name!r}: render.allocation = {scene.render.allocation!r}: while the "
                f"scene changes all pixels take the same number of samples; set it to 'even'"
            )
        super().__init__(
            scene, device, wave_size, curves=curves, adjustable=True, geometry=geometry
        )
        #: Pixels that the film has room for.
        self.most_pixels = self.n_pixels

    def show(self, film: Film) -> None:
        """Forget all samples; the next ones are of a picture of another size, or of another window
        of it. Its filter is that of the scene.

        Raises
        ------
        ResourceError   more pixels than the film has room for
        SceneError      another filter
        """
        window = film.window
        if window.n_pixels > self.most_pixels:
            raise ResourceError(
                f"the film has room for {self.most_pixels} pixels, {window.width} x "
                f"{window.height} are asked for; make another renderer"
            )
        if film.filter != self.features.filter:
            raise SceneError(
                f"film.filter = {film.filter!r}: the kernels are built for "
                f"{self.features.filter!r}; make another renderer"
            )
        self.scene = msgspec.structs.replace(self.scene, film=film)
        self.film = replace(self.film, width=window.width, height=window.height)
        self.wavefront.film = self.film
        self._wave = wave_struct(self.scene, self.wavefront)
        if self.setup.learning:
            self.setup.learning.of_pixels(window.n_pixels)
        self.look(self.scene.chosen_camera)

    def change_lights(self, scene: Scene, lights: Lights) -> None:
        """Forget all samples; the next ones are lit by the environment and the lamps of a scene,
        around its body, and end where its [render] says.

        Parameters
        ----------
        scene : Scene       its fibres and grooms are those of the renderer's, its meshes too and
                            they emit no light
        lights : Lights     what it builds

        Raises
        ------
        SceneError          lights that need other kernels
        """
        fibres = [material.fibre for material in self.materials]
        kept = {
            name: getattr(self.features, name) for name in ("channels", "crop", "meshes", "motion")
        }
        features = scene_features(scene, fibres, lights).with_(
            **kept, point_radii=self.features.point_radii
        )
        if features != self.features or scene.has_bright_meshes:
            raise SceneError(
                f"scene {scene.name!r}: its lights need other kernels than are built; make another "
                f"renderer"
            )
        stages = self.wavefront
        stages.checks.forget(stages.light)
        stages.light = upload_lights(self.memory, lights, features, self.setup.middle)
        stages.checks.watch(stages.light)
        if features.area_lamps:
            stages.lamps = [stages.light]
        if features.surface is not None:
            stages.surface = [surface_struct(scene, features)]
        self.setup = replace(self.setup, n_negative=lights.n_negative)
        self.scene = scene.seen_by(self.scene.chosen_camera)
        self._wave = wave_struct(self.scene, self.wavefront)
        learning = self.setup.learning
        if learning:
            learning.begin_with(scene.render.survival_threshold, scene.render.shadow_threshold)
        self.restart(self.scene.render.seed)

    def change_fibres(
        self, scene: Scene, fibres: Mapping[str, Any], prepared: Mapping[str, Any] | None = None
    ) -> set[str]:
        """Forget all samples; the next ones meet fibres with other numbers.

        Parameters
        ----------
        scene : Scene           with the same materials, of the same models
        fibres : mapping        name of a material -> its parameters; others stay
        prepared : mapping      name of a material -> what its model prepared for the fibre; others
                                have what it drafts in a moment (`FibreModel.draft`)

        Returns
        -------
        set of str              materials that have a draft, which is noisier than what is prepared

        Raises
        ------
        FibreError              fibres that cannot be prepared
        SceneError              one that needs other kernels
        """
        made, drafted, prepared = {}, set(), prepared or {}
        for i, material in enumerate(self.materials):
            if material.name in fibres:
                name, fibre = material.name, fibres[material.name]
                if name in prepared:
                    profiles, noisier = prepared[name], False
                else:
                    profiles, noisier = material.model.draft(self.device, fibre)
                if noisier:
                    drafted.add(name)
                new = scene_material(
                    self.memory,
                    scene,
                    name,
                    fibre,
                    self.features,
                    False,
                    None,
                    profiles,
                ).with_features(self.features)
                if new.features != material.features:
                    raise SceneError(
                        f"material {material.name!r} needs other kernels than are built; make "
                        f"another renderer"
                    )
                made[i] = new
        for i, new in made.items():
            self.materials[i] = new
            self.wavefront.fibres[i].material = new
        self.material = self.materials[0]
        self.scene = scene.seen_by(self.scene.chosen_camera)
        self.restart(self.scene.render.seed)
        return drafted
