"""Cylinders without a medulla that tests look at, as fibres and as tables of scenes."""

from __future__ import annotations

from dataclasses import asdict
from importlib import import_module
from typing import Any

from furcl.fibre.chiang.parameters import ChiangFibre
from furcl.fibre.deon.parameters import DEonFibre
from furcl.fibre.model import model_of

COLOUR = (0.1, 0.4, 1.2)

FIBRES: dict[str, Any] = {
    "chiang": ChiangFibre(sigma_a=COLOUR),
    "chiang rough": ChiangFibre(beta_m=0.7, beta_n=0.8, alpha_deg=0.0, sigma_a=(0.3, 0.3, 0.3)),
    "deon": DEonFibre(sigma_a=COLOUR),
    "deon cone, 5 orders": DEonFibre(
        sigma_a=COLOUR, orders=5, cone=True, beta_m_deg=12.0, beta_n_deg=25.0
    ),
}


def reference_of(fibre: Any) -> Any:
    """The module of its float64 reference."""
    return import_module(model_of(fibre).reference)


def document(fibre: Any) -> dict[str, Any]:
    """A fibre of any model as a table of a scene."""
    values = asdict(fibre)
    # Measured fibres say where their values are from, which no scene does.
    values.pop("provenance", None)
    return {"model": fibre.model, **values}
