"""The table of a groom, where a scene has several."""

from __future__ import annotations

from furcl.errors import SceneError
from furcl.fibre.model import ModelTable
from furcl.groom.curves import Curves
from furcl.groom.joined import Transformed, placed
from furcl.groom.motion import Span, check_within, during, times_within
from furcl.groom.tables import CurvesTable
from furcl.scene.motion import TransformKey, check_keys, key_times, matrix_at
from furcl.scene.transform import Transform, moved
from furcl.table import Table


class Groom(Table, frozen=True, kw_only=True):
    """One of several grooms of a scene, with a name of its own.

    Attributes
    ----------
    curves : table          its strands
    fibre : table           what they are of; or a material
    material : str          name of a [material]; the scene's [fibre] if neither is given
    transform : table       where it stands
    keys : list of tables   how it moves from there, after transform: places at times
    """

    curves: CurvesTable
    fibre: ModelTable | None = None
    material: str | None = None
    transform: Transform = Transform()
    keys: tuple[TransformKey, ...] = ()

    def __post_init__(self) -> None:
        check_keys(self.keys)
        if self.fibre is not None and self.material is not None:
            raise ValueError(
                f"material = {self.material!r} is given beside fibre; give one or the other"
            )

    def build(self, name: str, span: Span = (0.0, 0.0)) -> Curves:
        """Its strands, in their places in the scene while the shutter is open.

        Parameters
        ----------
        name : str      of the groom, for messages
        span : floats   when the shutter opens and closes

        Raises
        ------
        GroomError      if the file cannot be used, the generator refuses its parameters, or the
                        shutter is open at times that the groom or its keys do not know
        SceneError      a transform that radii cannot follow
        """
        curves = during(self.curves.build(), span, f"groom {name}")
        if self.transform.is_identity and not self.keys:
            return curves
        try:
            scale = self.transform.uniform_scale()
        except ValueError as error:
            raise SceneError(f"groom.{name}.transform {error}") from None
        times, places = [span[0]], [self.transform.points]
        if self.keys:
            scale *= self.keys[0].uniform_scale()
            check_within(span, [key.time for key in self.keys], f"keys of groom {name}")
            times = times_within([*key_times(self.keys), *curves.times], span)
            places = [self._place(time) for time in times]
        elif curves.times:
            times, places = list(curves.times), places * len(curves.times)
        return placed(curves, places, scale, f"groom {name}", times)

    def _place(self, time: float) -> Transformed:
        """What takes points of its curves to where they are at a time."""
        matrix = matrix_at(self.keys, time) @ self.transform.as_matrix()
        return lambda points: moved(points, matrix)
