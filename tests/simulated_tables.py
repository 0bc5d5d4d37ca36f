"""Tables of simulated scattering that no walk made: smooth, and different in every row."""

from __future__ import annotations

import numpy as np

from furcl.fibre.double_cylinder import layout
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.simulated import SimulatedScattering, tables_of
from furcl.fibre.double_cylinder.whole_fibre_walk import table_channels


def smooth_tables(fibre: Fibre) -> SimulatedScattering:
    """Of the channels that the fibre has; forward lobes that turn with the offset and lean with the
    inclination, each channel in its own way."""
    channels = max(table_channels(fibre), 1)
    shape = (layout.SIMULATED_THETAS, layout.SIMULATED_OFFSETS, channels)
    i, j, c, phi, s = np.meshgrid(
        *(np.linspace(0.0, 1.0, n) for n in shape),
        (np.arange(layout.SIMULATED_PHIS) + 0.5) / layout.SIMULATED_PHIS * 2.0 * np.pi - np.pi,
        (np.arange(layout.SIMULATED_SINES) + 0.5) / layout.SIMULATED_SINES * 2.0 - 1.0,
        indexing="ij",
    )
    light = (1.2 - np.cos(phi - 0.7 * j)) * (1.0 - 0.5 * (s + 0.8 * i) * (1.0 - 0.3 * c))
    light *= 1.0 - 0.25 * c * np.cos(phi)
    share = 1.0 if table_channels(fibre) == 0 else 0.3 + 0.2 * i + 0.2 * j - 0.2 * c
    energy = share * light / light.sum(axis=(3, 4), keepdims=True)
    rows = (-1, channels, layout.SIMULATED_PHIS, layout.SIMULATED_SINES)
    stored = {"energy": energy.reshape(rows).astype(np.float32), "summary": np.zeros(3)}
    return tables_of(fibre, stored)
