"""A fibre as the kernels need it: its parameters, medulla profiles and attenuation tables."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from furcl import layout, program
from furcl.buffers import Memory
from furcl.features import Features
from furcl.fibre import Fibre
from furcl.medulla import MedullaProfiles, build_profiles
from furcl.tables import AttenuationTables, tables_from_bins

LOCAL_SIZE = 64


def fibre_params(fibre: Fibre) -> np.ndarray:
    """The struct FibreParams of a fibre, differences formed in float64."""
    params = np.zeros((), layout.struct_dtype("FibreParams"))
    params["sigma_ca"][:3] = fibre.sigma_ca
    params["sigma_ma"][:3] = fibre.sigma_ma
    params["eta"] = fibre.eta
    params["eta_sq_minus_one"] = (fibre.eta - 1.0) * (fibre.eta + 1.0)
    params["kappa"] = fibre.kappa
    params["one_minus_kappa"] = 1.0 - fibre.kappa
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


def fibre_features(fibre: Fibre, *, sampling: str, residual: bool = False) -> Features:
    """The features that a fibre alone decides; the rest are defaults.

    A medulla matters if kappa > 0 and it absorbs or scatters; scattered lobes if it scatters.
    """
    absorbs = any(s > 0.0 for s in fibre.sigma_ma)
    scattered = fibre.kappa > 0.0 and fibre.sigma_ms > 0.0
    grey_medulla = len(set(fibre.sigma_ma)) == 1
    return Features(
        sampling=sampling,
        channels=1 if grey_medulla and len(set(fibre.sigma_ca)) == 1 else 3,
        medulla=scattered or (fibre.kappa > 0.0 and absorbs),
        scattered=scattered,
        profile_channels=0 if not (scattered and absorbs) else 1 if grey_medulla else 3,
        layered=fibre.layers != 0.5,
        tilt=fibre.tilt != 0.0,
        residual=residual,
    )


@dataclass(frozen=True, eq=False)
class Material:
    """Device data of one fibre.

    Attributes
    ----------
    params : struct FibreParams
    profiles : MedullaProfiles or None      None without scattered lobes
    tables : AttenuationTables or None      None for samplers that need none
    profile_buffer, table_buffer : pyopencl.Buffer
    """

    fibre: Fibre
    features: Features
    params: np.ndarray
    profiles: MedullaProfiles | None
    tables: AttenuationTables | None
    profile_buffer: cl.Buffer
    table_buffer: cl.Buffer


def build_material(memory: Memory, fibre: Fibre, features: Features) -> Material:
    """Simulate or load the medulla profiles, tabulate the attenuation and upload both."""
    device = memory.device
    params = fibre_params(fibre)
    profiles = build_profiles(device, fibre) if features.scattered else None
    packed = profiles.pack() if profiles else np.zeros(0, np.float32)
    profile_buffer = memory.upload("profiles", packed)
    tables = None
    if features.sampler.needs_tables:
        bins = _attenuation_bins(memory, params, features, profile_buffer)
        tables = tables_from_bins(bins)
    table_buffer = memory.upload("tables", tables.packed if tables else np.zeros(0, np.float32))
    return Material(fibre, features, params, profiles, tables, profile_buffer, table_buffer)


def _attenuation_bins(
    memory: Memory, params: np.ndarray, features: Features, profile_buffer: cl.Buffer
) -> np.ndarray:
    """(TABLE_ROWS, n_lobes, TABLE_BINS) float32 bin means of A_p, from kernels/tables.cl."""
    device = memory.device
    theta = np.linspace(0.0, 0.5 * np.pi, layout.TABLE_ROWS)
    rows = np.stack([np.sin(theta), np.cos(theta)], 1).astype(np.float32)
    shape = (layout.TABLE_ROWS, features.n_lobes, layout.TABLE_BINS)
    local = Memory(device)
    out = local.allocate("bins", 4 * int(np.prod(shape)))
    kernel = cl.Kernel(program.build(device, "tables.cl", features), "attenuation_bins")
    n_items = layout.TABLE_ROWS * layout.TABLE_BINS
    kernel(
        device.queue,
        (-(-n_items // LOCAL_SIZE) * LOCAL_SIZE,),
        (LOCAL_SIZE,),
        out,
        local.upload("rows", rows),
        params,
        profile_buffer,
    )
    return local.read(out, shape)
