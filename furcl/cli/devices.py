"""`furcl devices` and `furcl doctor`."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

EXIT_NO_DEVICE = 3


def devices() -> None:
    """List the OpenCL devices, what the self-test says of each, and the one furcl uses."""
    from furcl.device.choice import RULE, choose, list_candidates
    from furcl.errors import DeviceError

    candidates = list_candidates()
    for candidate in candidates:
        verdict = candidate.verdict()
        outcome = "passes the self-test" if verdict.passed else f"NOT USABLE: {verdict.reason}"
        typer.echo(f"{candidate.index}: {candidate.kind}  {candidate.description}")
        typer.echo(f"   {candidate.runtime_version}")
        typer.echo(
            f"   address {candidate.address}, {candidate.compute_units} compute units, "
            f"{candidate.memory_bytes / 2**30:.1f} GiB; {outcome}"
        )
    wanted = os.environ.get("FURCL_DEVICE", "")
    try:
        chosen = choose(candidates, wanted, "FURCL_DEVICE")
    except DeviceError as error:
        typer.echo(f"furcl: {error}", err=True)
        raise typer.Exit(EXIT_NO_DEVICE) from None
    why = f"FURCL_DEVICE is {wanted!r}" if wanted else RULE
    typer.echo(f"furcl uses device {chosen.index}: {why}")


def doctor(
    install: Annotated[
        bool, typer.Option("--install", help="Offer a runtime where no device is usable.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="With --install, do not ask.")] = False,
) -> None:
    """Say what is wrong with this installation and which command mends it."""
    from furcl.install.doctor import diagnose

    if install:
        from furcl.install.provision import offer

        if not offer(lambda question: yes or _asked(question)):
            raise typer.Exit(EXIT_NO_DEVICE)
        return
    errors = 0
    for finding in diagnose():
        errors += finding.level == "error"
        typer.echo(f"{finding.level:<8} {finding.what}: {finding.found}")
        if finding.remedy:
            typer.echo(f"         mend it: {finding.remedy}")
    if errors:
        typer.echo(f"{errors} things keep furcl from working; mend them in this order.")
        raise typer.Exit(EXIT_NO_DEVICE)
    typer.echo("furcl can render here.")


def _asked(question: str) -> bool:
    """The answer of whoever sits there; no where nobody does."""
    if sys.stdin is None or not sys.stdin.isatty():
        typer.echo(f"{question} Nobody is there to ask: --yes agrees.")
        return False
    return typer.confirm(question)


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command()(devices)
    app.command()(doctor)
