"""A fibre as the kernels need it: its parameters, medulla profiles and attenuation tables."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from furcl.device import index_checks, layout, program
from furcl.device.features import ALL_LOBES, SCATTERED_LOBES, Features
from furcl.device.launch import grid
from furcl.device.memory import Memory
from furcl.fibre.attenuation import (
    GRAZING_ROWS,
    ROWS_BETWEEN,
    AttenuationTables,
    peak_angles,
    peaks_around,
    tables_from_bins,
)
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles, build_profiles

# A lobe that carries a smaller share of the energy than this at every theta may be left out: the
# largest bias of a pixel, relative to it, for each such lobe and bounce.
NEGLIGIBLE_SHARE = 1e-6


def fibre_params(fibre: Fibre) -> np.ndarray:
    """The struct FibreParams of a fibre, differences formed in float64."""
    params = np.zeros((), layout.struct_dtype("FibreParams"))
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


def fibre_features(fibre: Fibre, *, sampling: str, residual: bool = False) -> Features:
    """The features that a fibre alone decides; the rest are defaults.

    A medulla matters if kappa > 0 and anything absorbs or scatters: a clear one shortens the way
    through the cortex. Scattered lobes exist if it scatters.
    """
    absorbs = any(s > 0.0 for s in fibre.sigma_ma)
    scattered = fibre.kappa > 0.0 and fibre.sigma_ms > 0.0
    grey_medulla = len(set(fibre.sigma_ma)) == 1
    return Features(
        sampling=sampling,
        channels=1 if grey_medulla and len(set(fibre.sigma_ca)) == 1 else 3,
        medulla=scattered
        or (fibre.kappa > 0.0 and (absorbs or any(s > 0.0 for s in fibre.sigma_ca))),
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


def build_material(
    memory: Memory,
    fibre: Fibre,
    features: Features,
    *,
    drop_lobes: bool = False,
    profiles: MedullaProfiles | None = None,
) -> Material:
    """Simulate or load the medulla profiles, unless given, tabulate the attenuation, upload both.

    With `drop_lobes` lobes whose share of the energy is below NEGLIGIBLE_SHARE at every theta are
    left out: they are in `Material.features.dropped_lobes`, get no part of the tables, and where no
    scattered lobe remains nothing of them is uploaded.
    """
    device = memory.device
    params = fibre_params(fibre)
    if not features.scattered:
        profiles = None
    elif profiles is None:
        profiles = build_profiles(device, fibre)
    packed = profiles.pack(features.profile_channels) if profiles else _empty_profiles(features)
    bins = None
    if drop_lobes or features.sampler.needs_tables:
        bins = _attenuation_bins(Memory(device), params, features, packed)
    if drop_lobes and bins is not None:
        features, bins = _without_negligible(features, bins)
        if not features.scattered:
            profiles, packed = None, _empty_profiles(features)
    needs_tables = bins is not None and features.sampler.needs_tables
    tables = tables_from_bins(*bins) if bins is not None and needs_tables else None
    packed_tables = tables.packed if tables else np.zeros(0, np.float32)
    return Material(
        fibre,
        features,
        params,
        profiles,
        tables,
        index_checks.upload(memory, "profiles", packed, features.debug),
        index_checks.upload(memory, "tables", packed_tables, features.debug),
    )


def _empty_profiles(features: Features) -> np.ndarray:
    """Zeros where kernels with scattered lobes run on a fibre that has none; else nothing."""
    if not features.scattered:
        return np.zeros(0, np.float32)
    rows = layout.PROFILE_TAUS * layout.PROFILE_OFFSETS
    azimuth = rows * (
        layout.PROFILE_PHIS * (1 + features.profile_channels) + features.profile_channels
    )
    return np.zeros(azimuth + 4 * layout.PROFILE_THETAS * layout.PROFILE_SINES, np.float32)


def _without_negligible(features: Features, bins: np.ndarray) -> tuple[Features, np.ndarray]:
    """Features without the lobes that carry next to nothing, and bins with zeros for them."""
    energy = bins[0].mean(axis=2, dtype=np.float64)
    total = energy.sum(axis=1, keepdims=True)
    share = np.divide(energy, total, out=np.zeros_like(energy), where=total > 0.0).max(axis=0)
    dropped = tuple(
        name
        for name, largest in zip(ALL_LOBES, share, strict=False)
        if name in features.lobes and largest < NEGLIGIBLE_SHARE
    )
    kept = features.with_(dropped_lobes=dropped)
    if not set(kept.lobes) & set(SCATTERED_LOBES):
        kept = kept.with_(scattered=False, profile_channels=0)
    gone = [i for i, name in enumerate(ALL_LOBES[: features.n_lobes]) if name in dropped]
    bins = bins.copy()
    bins[:, :, gone] = 0.0
    return kept, bins


def _attenuation_bins(
    memory: Memory, params: np.ndarray, features: Features, profiles: np.ndarray
) -> np.ndarray:
    """Means and peaks (2, TABLE_ROWS, n_lobes, TABLE_BINS) of A_p, float32, from
    kernels/prepare/tables.cl: what `tables_from_bins` takes."""
    device = memory.device
    theta = peak_angles(layout.TABLE_ROWS)
    rows = np.stack([np.sin(theta), np.cos(theta)], 1).astype(np.float32)
    shape = (len(rows), features.n_lobes, layout.TABLE_BINS, 2)
    out = memory.allocate("bins", 4 * int(np.prod(shape)))
    kernel = cl.Kernel(program.build(device, "prepare/tables.cl", features), "attenuation_bins")
    n_items = len(rows) * layout.TABLE_BINS
    profile_buffer = index_checks.upload(memory, "profiles", profiles, features.debug)
    checks = index_checks.IndexChecks(device.queue, features)
    checks.watch(profile_buffer)
    kernel(
        device.queue,
        *grid(n_items),
        out,
        memory.upload("rows", rows),
        np.uint32(len(rows)),
        params,
        profile_buffer,
    )
    checks.check("attenuation_bins")
    means, peaks = np.moveaxis(memory.read(out, shape), -1, 0)
    means = means[:-GRAZING_ROWS:ROWS_BETWEEN]
    return np.stack([means, peaks_around(peaks)])
