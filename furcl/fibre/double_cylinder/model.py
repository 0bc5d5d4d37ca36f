"""The double cylinder as a fibre model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from furcl.device.layout import struct_dtype
from furcl.fibre.double_cylinder import layout
from furcl.fibre.double_cylinder.features import DoubleCylinderFeatures
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.table import FibreTable
from furcl.fibre.model import FibreModel
from furcl.fibre.pigment import sigma_ca_from_colours

if TYPE_CHECKING:
    from furcl.device.choice import Device
    from furcl.fibre.double_cylinder.profiles import MedullaProfiles
    from furcl.fibre.double_cylinder.simulated import SimulatedScattering


class DoubleCylinder(FibreModel):
    """Cuticle, cortex and a scattering medulla; docs/model.md."""

    name = "double-cylinder"
    lobes = layout.LOBES
    header = Path("fibre/double_cylinder/bcsdf.clh")
    struct = layout.STRUCT
    reference = "furcl.fibre.double_cylinder.reference"
    absorbed = "sigma_ca"

    @property
    def table(self) -> type[FibreTable]:
        return FibreTable

    def constants(self) -> Mapping[str, int | str]:
        return layout.CONSTANTS

    def features(self, fibre: Fibre, *, residual: bool = False) -> DoubleCylinderFeatures:
        """A medulla matters if kappa > 0 and anything absorbs or scatters: a clear one shortens the
        way through the cortex. Scattered lobes exist if it scatters, and where they are simulated
        the residual always does."""
        absorbs = any(s > 0.0 for s in fibre.sigma_ma)
        scattered, simulated = fibre.has_medulla, fibre.is_simulated
        absorbed, grey = absorbs, len(set(fibre.sigma_ma)) == 1
        if simulated:
            absorbed, grey = absorbs or any(s > 0.0 for s in fibre.sigma_ca), self.is_grey(fibre)
        return DoubleCylinderFeatures(
            medulla=scattered
            or (fibre.kappa > 0.0 and (absorbs or any(s > 0.0 for s in fibre.sigma_ca))),
            scattered=scattered,
            profile_channels=0 if not (scattered and absorbed) else 1 if grey else 3,
            layered=fibre.layers != 0.5,
            tilt=fibre.tilt != 0.0,
            residual=residual or simulated,
            simulated=simulated,
        )

    def is_grey(self, fibre: Fibre) -> bool:
        return len(set(fibre.sigma_ma)) == 1 and len(set(fibre.sigma_ca)) == 1

    def params(self, fibre: Fibre) -> np.ndarray:
        """FibreParams, differences formed in float64."""
        params = np.zeros((), struct_dtype(self.struct))
        params["sigma_ca"][:3] = fibre.sigma_ca
        params["sigma_ma"][:3] = fibre.sigma_ma
        params["eta"] = fibre.eta
        params["eta_sq_minus_one"] = (fibre.eta - 1.0) * (fibre.eta + 1.0)
        params["kappa"] = fibre.kappa
        params["one_minus_kappa"] = 1.0 - fibre.kappa
        params["kappa_low"] = fibre.kappa - float(np.float32(fibre.kappa))
        kappa_sq_e = fibre.kappa**2 * (fibre.eta - 1.0) * (fibre.eta + 1.0)
        params["kappa_sq_e"] = kappa_sq_e
        params["kappa_sq_e_low"] = kappa_sq_e - float(np.float32(kappa_sq_e))
        params["sigma_ms"] = fibre.sigma_ms
        params["layers"] = fibre.layers
        params["beta_m"] = fibre.beta_m
        params["beta_n"] = fibre.beta_n
        params["tilt"] = fibre.tilt
        params["sin_tilt"], params["cos_tilt"] = math.sin(fibre.tilt), math.cos(fibre.tilt)
        params["sin_tilt_trt"] = math.sin(3.0 * fibre.tilt)
        params["cos_tilt_trt"] = math.cos(3.0 * fibre.tilt)
        cos_min = math.sqrt((fibre.eta - 1.0) * (fibre.eta + 1.0)) / fibre.eta
        params["profile_taus_per_cos"] = (layout.PROFILE_TAUS - 1) / (1.0 - cos_min)
        return params

    def prepare(self, device: Device, fibre: Fibre) -> MedullaProfiles | SimulatedScattering | None:
        """The profiles of the medulla, or tables of the light that it scatters, simulated or
        loaded; None if it scatters nothing."""
        if fibre.is_simulated:
            from furcl.fibre.double_cylinder.simulated import build_simulated

            return build_simulated(device, fibre)
        from furcl.fibre.double_cylinder.profiles import build_profiles

        return build_profiles(device, fibre)

    def why_one_absorption(self, fibre: Fibre) -> str | None:
        if not fibre.is_simulated:
            return None
        return (
            "fibre.scattering = 'simulated': its tables are for one absorption, and strands or "
            "points have others; allowed is 'model'"
        )

    def draft(self, device: Device, fibre: Fibre) -> tuple[Any, bool]:
        """Profiles of few photons, where none are stored: tests/test_view_follow.py has their
        error. Of simulated scattering the tables themselves."""
        if fibre.is_simulated:
            return self.prepare(device, fibre), False
        from furcl.fibre.double_cylinder.profiles import draft_profiles

        return draft_profiles(device, fibre)

    def absorption_of_colour(self, fibre: Fibre, colour: np.ndarray) -> np.ndarray:
        return sigma_ca_from_colours(colour, fibre.beta_n_deg)

    def data(
        self,
        prepared: MedullaProfiles | SimulatedScattering | None,
        features: DoubleCylinderFeatures,
    ) -> np.ndarray:
        """The packed profiles or tables; zeros where kernels with scattered lobes run on a fibre
        that has none."""
        if prepared is None or not features.scattered:
            return np.zeros(features.data_words, np.float32)
        return prepared.pack(features.profile_channels)


MODEL = DoubleCylinder()
