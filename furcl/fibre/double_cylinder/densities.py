"""The two factors of the density of a lobe on a device, each alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.device import program
from furcl.device.launch import fibre_grid
from furcl.device.memory import Memory
from furcl.fibre.material import FibreMaterial


def lobe_densities(
    memory: Memory,
    material: FibreMaterial,
    lobe: int,
    theta_in: NDArray[np.floating],
    theta_out: NDArray[np.floating],
    phi: NDArray[np.floating],
    turned: NDArray[np.floating],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Longitudinal and azimuthal density of R, TT or TRT.

    Parameters
    ----------
    memory : Memory         of the device that the material is on
    lobe : int              0, 1 or 2
    theta_in : (n,)         inclination of wo [rad]
    theta_out : (n,)        inclination of wi [rad]
    phi : (n,)              azimuth of wi from wo [rad], on which the centre of R depends
    turned : (n,)           azimuth of wi from the lobe's centre [rad]

    Returns
    -------
    m : (n,) float32        longitudinal, per unit of sin(theta_out); integral 1
    d : (n,) float32        azimuthal [1/rad]; integral 1
    """
    n, memory = len(theta_in), Memory(memory.device)
    theta = np.stack([np.sin(theta_in), np.cos(theta_in)], 1).astype(np.float32)
    to = np.stack([np.sin(theta_out), np.cos(theta_out), phi, turned], 1).astype(np.float32)
    out = [memory.allocate(name, 4 * n) for name in ("longitudinal", "azimuthal")]
    file = "tools/double_cylinder_densities.cl"
    built = program.build(memory.device, file, material.features)
    program.kernel_of(built, "double_cylinder_densities")(
        memory.device.queue,
        *fibre_grid(memory.device, n),
        memory.upload("theta", theta),
        memory.upload("to", to),
        *out,
        np.uint32(n),
        np.uint32(lobe),
        material.buffer,
    )
    return memory.read(out[0], n), memory.read(out[1], n)
