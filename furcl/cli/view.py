"""`furcl view`."""

from __future__ import annotations

from typing import Annotated

import typer

from furcl.cli.interrupt import interruptible
from furcl.cli.options import SIZE, SPP, DeviceName, Material, Overrides, SceneName, UpAxis

#: How often a signal is looked for [s].
LOOK_S = 0.2


def view(
    scene: SceneName,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of the page's address; 0: one that is free.")
    ] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    spp: Annotated[int | None, SPP] = None,
    size: Annotated[str | None, SIZE] = None,
    device: DeviceName = None,
    material: Material = None,
    up: UpAxis = None,
    overrides: Overrides = None,
) -> None:
    """Show a scene, or a groom, on a page in the browser, where it renders and is changed.

    The page is served on this machine alone, until Ctrl-C.
    """
    from furcl.cli.render import of_groom
    from furcl.scene.from_groom import is_groom
    from furcl.scene.read import find_scene, load_scene
    from furcl.viewer.show import View

    bare = is_groom(find_scene(scene))
    loaded = load_scene(
        scene,
        overrides=[*of_groom(bare, material, up), *(overrides or ())],
        spp=spp,
        size=size,
    )
    with interruptible("stopping") as interrupt, View(loaded, device, port) as shown:
        typer.echo(shown.address)
        if browser:
            _open(shown.address)
        while not (interrupt.requested or shown.session.ended.wait(LOOK_S)):
            pass
        if shown.session.failure:
            raise shown.session.failure
    if interrupt.requested:
        raise interrupt.exit()


def _open(address: str) -> None:
    import webbrowser

    if not webbrowser.open(address):
        typer.echo("open this address in a browser", err=True)


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command()(view)
