"""Values, densities and tables of any fibre model, for other renderers to check themselves by.

Numbers come from the model's float64 reference; tables are those that kernels read.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.device import layout
from furcl.device.choice import Device
from furcl.errors import FibreError
from furcl.fibre.attenuation import row_angles
from furcl.fibre.model import FibreModel, model_of
from furcl.files import atomic_path, check_writable
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

_PANELS = 256
_NODES = 16


def bcsdf_values(
    fibre: Any,
    wo: Array,
    wi: Array,
    h: float | None = None,
    prepared: Any = None,
    *,
    sampling: str = "full-cdf",
    residual: bool = False,
) -> dict[str, Any]:
    """What a fibre sends from wi to wo, lobe by lobe.

    Parameters
    ----------
    fibre : object          parameters, of a model's own class
    wo, wi : (3,)           unit vectors in the fibre's frame
    h : float or None       offset, [-1, 1]; None: the mean over it, the far field
    prepared : object       what the model prepared (`FibreModel.prepare`), or stands for it
    sampling : str          of the densities
    residual : bool         with the lobe that holds all orders which the others leave out

    Returns
    -------
    dict    value (r, g, b) [1/sr], pdf [1/sr], lobes: name -> value, attenuation (r, g, b), pdf
            [1/sr]. At an h pdf is the density of (lobe, h, wi) per unit of h, and each lobe has a
            direction_pdf, that of wi once lobe and h are chosen; of the far field it is the density
            of wi, and value and attenuation are means over h, Gauss-Legendre sums over 4096 nodes
            in asin(h) (tests/test_bcsdf_command.py)

    Raises
    ------
    FibreError      directions that are no unit vectors, h outside its range, nothing prepared of a
                    fibre that needs it, an unknown sampling
    """
    model = model_of(fibre)
    reference = import_module(model.reference)
    at, weight = _offsets(model, h)
    theta = float(np.arctan2(wo[0], np.hypot(wo[1], wo[2])))
    energies = reference.attenuation(fibre, at, theta, prepared, residual=residual)

    def mean(values: Array) -> Any:
        return np.tensordot(weight, values, 1).tolist()

    def of(function: Callable[..., Array], **keywords: Any) -> Any:
        return mean(function(fibre, wo, wi, at, prepared, **keywords))

    # Of the far field the density is an integral over h, whose width is 2.
    width = 1.0 if h is not None else 2.0
    drawn = {"sampling": sampling, "residual": residual}
    lobes = {}
    for name, energy in energies.items():
        lobes[name] = {
            "value": of(reference.evaluate, lobe=name),
            "attenuation": mean(energy),
            "pdf": width * of(reference.pdf, lobe=name, **drawn),
        }
        if h is not None:
            directions = of(reference.direction_pdf, lobe=name, sampling=sampling)
            lobes[name]["direction_pdf"] = directions
    return {
        "value": of(reference.evaluate, residual=residual),
        "pdf": width * of(reference.pdf, **drawn),
        "lobes": lobes,
    }


def _offsets(model: FibreModel, h: float | None) -> tuple[Array, Array]:
    """Offsets and their weights, which add up to 1."""
    if h is not None or not model.has_offset:
        return np.array([0.0 if h is None else h]), np.ones(1)
    x, w = np.polynomial.legendre.leggauss(_NODES)
    edges = np.linspace(-np.pi / 2, np.pi / 2, _PANELS + 1)
    half = 0.5 * np.diff(edges)
    gamma = (edges[:-1] + half)[:, None] + half[:, None] * x
    weight = 0.5 * half[:, None] * w * np.cos(gamma)
    return np.sin(gamma).ravel(), weight.ravel()


def save_tables(
    path: str | os.PathLike[str],
    fibre: Any,
    *,
    sampling: str = "full-cdf",
    residual: bool = False,
    device: str | Device | None = None,
) -> dict[str, tuple[int, ...]]:
    """Write the tables of a fibre to an .npz file.

    Parameters
    ----------
    path : path     ends with .npz; replaced when all is written
    fibre, sampling, residual : as for `bcsdf_values`
    device : str, Device or None    which fills them, as for furcl.render

    Returns
    -------
    dict    name of each array -> its shape: lobes (names), theta (rows) [rad], h_edges
            (bins + 1), lobe_cdf, bin_cdf, joint, energy (furcl.fibre.attenuation), phi (nodes)
            [rad], marginals (furcl.fibre.marginal), params of the device, and the arrays of what
            the model prepares, such as prepared.azimuth.density

    Raises
    ------
    FibreError      a name that does not end with .npz, or cannot be written
    DeviceError     no usable device
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise FibreError(f"{path}: tables are written to .npz files; end the name with .npz")
    check_writable(path, FibreError)
    probe = Probe(fibre, sampling, device, residual=residual, light_sampling=True)
    material = probe.material
    arrays: dict[str, Any] = {
        "lobes": np.array(material.lobes),
        "theta": row_angles(layout.TABLE_ROWS),
        "phi": np.linspace(0.0, np.pi, layout.MARGINAL_PHIS),
        "marginals": material.marginals,
        "params": material.params,
    }
    if material.tables is not None:
        arrays |= {"h_edges": np.linspace(0.0, 1.0, layout.TABLE_BINS + 1)}
        arrays |= _arrays("", material.tables)
    if material.profiles is not None:
        arrays |= _arrays("prepared.", material.profiles)
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)
    return {name: np.shape(array) for name, array in arrays.items()}


def _arrays(prefix: str, holder: Any) -> Mapping[str, Any]:
    """The arrays of a dataclass and of those in it, by dotted names."""
    found: dict[str, Any] = {}
    for field in dataclasses.fields(holder):
        value, name = getattr(holder, field.name), f"{prefix}{field.name}"
        if dataclasses.is_dataclass(value):
            found |= _arrays(f"{name}.", value)
        elif isinstance(value, np.ndarray):
            found[name] = value
    return found
