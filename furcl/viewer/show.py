"""`furcl.view`: a scene on a page in the browser, or in a notebook."""

from __future__ import annotations

import html
import os
from types import TracebackType

from furcl.device.choice import Device
from furcl.errors import SceneError
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene
from furcl.viewer.session import Session

FRAME_HEIGHT = 720


class View:
    """A page that is being served; shows itself in a notebook.

    Attributes
    ----------
    session : Session
    address : str           of the page, on this machine alone
    """

    def __init__(self, scene: Scene, device: str | Device | None = None, port: int = 0) -> None:
        try:
            from furcl.viewer.server import ViewServer
        except ModuleNotFoundError as error:
            raise SceneError(
                f"the live view needs a package: {error}; install it: pip install 'furcl[view]'"
            ) from None
        self.session = Session(scene, device)
        try:
            self._server = ViewServer(self.session, port)
        except BaseException:
            self.session.close()
            raise
        self.address = self._server.address

    def close(self) -> None:
        """Stop rendering and serving; pages say so."""
        self.session.close()
        self._server.close()

    def __enter__(self) -> View:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"View({self.address!r})"

    def _repr_html_(self) -> str:
        return (
            f'<iframe src="{html.escape(self.address)}" width="100%" height="{FRAME_HEIGHT}" '
            f'style="border: 0" title="furcl"></iframe>'
        )


def view(
    scene: Scene | str | os.PathLike,
    *,
    device: str | Device | None = None,
    port: int = 0,
    size: tuple[int, int] | str | None = None,
    spp: int | None = None,
) -> View:
    """Show a scene on a page, where it renders and is changed (docs/view.md).

    Parameters
    ----------
    scene : Scene or path of a scene file
    device : str or None        as for `furcl.render`
    port : int                  of the page's address; 0: one that is free
    size : (width, height)      of the picture, in place of the scene's [pixels]
    spp : int or None           samples a pixel, in place of the scene's

    Returns
    -------
    View        shows itself in a notebook; renders until it is closed

    Raises
    ------
    SceneError, DeviceError
    """
    loaded = scene if isinstance(scene, Scene) else load_scene(scene)
    return View(with_overrides(loaded, size=size, spp=spp), device, port)
