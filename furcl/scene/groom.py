"""The table of a groom, where a scene has several."""

from __future__ import annotations

from furcl.errors import SceneError
from furcl.fibre.model import ModelTable
from furcl.groom.curves import Curves
from furcl.groom.joined import placed
from furcl.groom.tables import CurvesTable
from furcl.scene.transform import Transform
from furcl.table import Table


class Groom(Table, frozen=True, kw_only=True):
    """One of several grooms of a scene, with a name of its own.

    Attributes
    ----------
    curves : table          its strands
    fibre : table           what they are of; or a material
    material : str          name of a [material]; the scene's [fibre] if neither is given
    transform : table       where it stands
    """

    curves: CurvesTable
    fibre: ModelTable | None = None
    material: str | None = None
    transform: Transform = Transform()

    def __post_init__(self) -> None:
        if self.fibre is not None and self.material is not None:
            raise ValueError(
                f"material = {self.material!r} is given beside fibre; give one or the other"
            )

    def build(self, name: str) -> Curves:
        """Its strands, in their place in the scene.

        Parameters
        ----------
        name : str      of the groom, for messages

        Raises
        ------
        GroomError      if the file cannot be used, or the generator refuses its parameters
        SceneError      a transform that radii cannot follow
        """
        curves = self.curves.build()
        if self.transform.is_identity:
            return curves
        try:
            scale = self.transform.uniform_scale()
        except ValueError as error:
            raise SceneError(f"groom.{name}.transform {error}") from None
        return placed(curves, self.transform.points, scale, f"groom {name}")
