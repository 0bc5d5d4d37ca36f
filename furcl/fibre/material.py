"""A fibre as the kernels need it: one buffer of its parameters, data and attenuation tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyopencl as cl

from furcl.device import index_checks, layout, program
from furcl.device.features import Features
from furcl.device.launch import fibre_grid
from furcl.device.memory import Memory
from furcl.errors import FibreError
from furcl.fibre.attenuation import (
    GRAZING_ROWS,
    ROWS_BETWEEN,
    AttenuationTables,
    node_absorptions,
    node_scale,
    peak_angles,
    peaks_around,
    row_angles,
    tables_from_bins,
)
from furcl.fibre.marginal import marginals_from_sums
from furcl.fibre.model import FibreFeatures, FibreModel, check_mode, model_of
from furcl.fibre.samplers import Sampler, in_mode

# A lobe that carries a smaller share of the energy than this at every theta may be left out: the
# largest bias of a pixel, relative to it, for each such lobe and bounce.
NEGLIGIBLE_SHARE = 1e-6


# Name of the material of a scene that has [fibre].
SHORT_FORM = "fibre"


@dataclass(frozen=True, eq=False)
class FibreMaterial:
    """Device data of one fibre and its sampler.

    Attributes
    ----------
    name : str                          as scenes call it
    fibre : object                      parameters, of the model's own class
    model : FibreModel
    features : Features                 of its kernels: the scene's, with fibre and sampler
    params : struct FibreParams
    profiles : object or None           what the model prepared (`FibreModel.prepare`), if used
    tables : AttenuationTables or None  None for samplers that need none; where the absorption
                                        differs, those of the smallest
    marginals : (rows, phis, lobes) or None     densities of lobe and azimuth, where the light is
                                        sampled: furcl.fibre.marginal; of the smallest absorption
    buffer : cl.Buffer                  params, data, tables: kernels/include/fibre/material.clh
    absorption : cl.Buffer or None      of its strands or points:
                                        kernels/include/fibre/absorption.clh
    """

    name: str
    fibre: Any
    model: FibreModel
    features: Features
    params: np.ndarray
    profiles: Any
    tables: AttenuationTables | None
    marginals: np.ndarray | None
    buffer: cl.Buffer
    absorption: cl.Buffer | None = None

    @property
    def fibre_features(self) -> FibreFeatures:
        """The part of the features that is the fibre's."""
        assert isinstance(self.features.fibre, FibreFeatures)
        return self.features.fibre

    def with_features(self, features: Features) -> FibreMaterial:
        """The same material in a scene of other features; its own parts stay."""
        names = ("fibre", "sampler", "absorption", "mode")
        own = {name: getattr(self.features, name) for name in names}
        return replace(self, features=features.with_(**own))

    @property
    def lobes(self) -> tuple[str, ...]:
        """Names of the lobes in the order of every lobe axis and index, compiled in or not."""
        return tuple(lobe.name for lobe in self.model.lobes[: self.fibre_features.n_lobes])


def build_material(
    memory: Memory,
    fibre: Any,
    features: Features,
    sampler: Sampler,
    *,
    residual: bool = False,
    fibre_features: FibreFeatures | None = None,
    drop_lobes: bool = False,
    profiles: Any = None,
    name: str = SHORT_FORM,
    absorbs: tuple[float, float] | None = None,
    absorption: np.ndarray | None = None,
) -> FibreMaterial:
    """Prepare a fibre's data, tabulate its attenuation, upload both.

    Parameters
    ----------
    fibre : object              parameters, of a model's own class
    features : Features         of the scene, without fibre and sampler; with absorption and mode of
                                the material
    residual : bool             with the lobe that closes the furnace, if the model has one
    fibre_features : FibreFeatures or None  compile for these instead of what the fibre needs
    drop_lobes : bool           leave out lobes whose share of the energy is below NEGLIGIBLE_SHARE
                                at every theta: they get no part of the tables
    profiles : object or None   used instead of what the model prepares for this fibre
    name : str                  of the material
    absorbs : (low, high)       the smallest and the largest absorption of any channel at any hit,
                                where it is not that of the fibre: low < high
    absorption : (n,) uint32    what furcl.fibre.packed makes of them, where strands or points
                                have values

    Raises
    ------
    FibreError, KernelBuildError, ResourceError; FibreError also for absorption that differs, where
                    the fibre's data are for one
    SamplerError    a sampler of one's own in another mode than "far"
    """
    model = model_of(fibre)
    check_mode(model, features.mode)
    sampler = in_mode(sampler, features.mode)  # pyright: ignore[reportArgumentType]
    known = features.mode == "near"
    assert (absorbs is None) == (features.absorption == "constant")
    why_not = model.why_one_absorption(fibre)
    if absorbs is not None and why_not:
        raise FibreError(why_not)
    needed = fibre_features or model.features(fibre, residual=residual)
    params = model.params(fibre)
    if needed.data_words == 0:
        profiles = None
    elif profiles is None:
        profiles = model.prepare(memory.device, fibre)
    nodes = [params] if absorbs is None else _absorbing(model, params, absorbs)
    bins = []
    if drop_lobes or sampler.needs_tables or (absorbs is not None and not known):
        data = model.data(profiles, needed)
        unlit = features.with_(
            fibre=needed, light_sampling=False, absorption="constant", mode="far"
        )
        bins = [
            _attenuation_bins(Memory(memory.device), unlit, _packed(node, data)) for node in nodes
        ]
    if drop_lobes and bins:
        needed, bins = _without_negligible(model, needed, bins)
    if needed.data_words == 0:
        profiles = None
    data = model.data(profiles, needed)
    of_nodes = [tables_from_bins(*node) for node in bins]
    tables = of_nodes if sampler.needs_tables else []
    own = features.with_(fibre=needed, sampler=sampler)
    marginals = []
    if own.marginals:
        alone = own.with_(absorption="constant", mode="far")
        for i, node in enumerate(nodes):
            packed = _packed(node, data, *(table.packed for table in tables[i : i + 1]))
            marginals.append(_marginals(Memory(memory.device), alone, packed))
    parts = [params, data]
    if absorbs is not None and not known:
        parts += [node_scale(absorbs), np.array([table.energy for table in of_nodes], np.float32)]
    parts += [*(table.packed for table in tables), *marginals]

    def upload(kind: str, array: np.ndarray) -> cl.Buffer:
        of_material = kind if name == SHORT_FORM else f"{kind}: {name}"
        return index_checks.upload(memory, of_material, array, features.debug)

    return FibreMaterial(
        name,
        fibre,
        model,
        own,
        params,
        profiles,
        tables[0] if tables else None,
        marginals[0] if marginals else None,
        upload("material", _packed(*parts)),
        None if absorption is None else upload("absorption", absorption),
    )


def _absorbing(
    model: FibreModel, params: np.ndarray, absorbs: tuple[float, float]
) -> list[np.ndarray]:
    """FibreParams for each absorption that there are tables for."""
    nodes = []
    for sigma in node_absorptions(absorbs):
        nodes.append(params.copy())
        nodes[-1][model.absorbed] = sigma
    return nodes


def _packed(*parts: np.ndarray) -> np.ndarray:
    """Parts one after the other, as float32 words."""
    return np.frombuffer(b"".join(part.tobytes() for part in parts), np.float32)


def _without_negligible(
    model: FibreModel, needed: FibreFeatures, bins: list[np.ndarray]
) -> tuple[FibreFeatures, list[np.ndarray]]:
    """Features without the lobes that carry next to nothing, and bins with zeros for them."""
    energy = np.concatenate([node[0] for node in bins]).mean(axis=2, dtype=np.float64)
    total = energy.sum(axis=1, keepdims=True)
    share = np.divide(energy, total, out=np.zeros_like(energy), where=total > 0.0).max(axis=0)
    names = [lobe.name for lobe in model.lobes[: needed.n_lobes]]
    gone = [
        i for i, name in enumerate(names) if name in needed.lobes and share[i] < NEGLIGIBLE_SHARE
    ]
    bins = [node.copy() for node in bins]
    for node in bins:
        node[:, :, gone] = 0.0
    return needed.without([names[i] for i in gone]), bins


def _attenuation_bins(memory: Memory, features: Features, packed: np.ndarray) -> np.ndarray:
    """Means and peaks (2, TABLE_ROWS, n_lobes, TABLE_BINS) of A_p, float32, from
    kernels/prepare/tables.cl: what `tables_from_bins` takes."""
    device = memory.device
    assert isinstance(features.fibre, FibreFeatures)
    theta = peak_angles(layout.TABLE_ROWS)
    rows = np.stack([np.sin(theta), np.cos(theta)], 1).astype(np.float32)
    shape = (len(rows), features.fibre.n_lobes, layout.TABLE_BINS, 2)
    out = memory.allocate("bins", 4 * int(np.prod(shape)))
    built = program.build(device, "prepare/tables.cl", features)
    kernel = program.kernel_of(built, "attenuation_bins")
    n_items = len(rows) * layout.TABLE_BINS
    material = index_checks.upload(memory, "material", packed, features.debug)
    checks = index_checks.IndexChecks(device.queue, features)
    checks.watch(material)
    uploaded = memory.upload("rows", rows)
    size = fibre_grid(device, n_items)
    kernel(device.queue, *size, out, uploaded, np.uint32(len(rows)), material)
    checks.check("attenuation_bins")
    means, peaks = np.moveaxis(memory.read(out, shape), -1, 0)
    means = means[:-GRAZING_ROWS:ROWS_BETWEEN]
    return np.stack([means, peaks_around(peaks)])


def _marginals(memory: Memory, features: Features, packed: np.ndarray) -> np.ndarray:
    """What `marginals_from_sums` makes of kernels/prepare/marginals.cl, (TABLE_ROWS, MARGINAL_PHIS,
    n_lobes) float32. `packed` is the material up to them."""
    device = memory.device
    assert isinstance(features.fibre, FibreFeatures)
    theta = row_angles(layout.TABLE_ROWS)
    rows = memory.upload("rows", np.stack([np.sin(theta), np.cos(theta)], 1).astype(np.float32))
    of_row = (layout.MARGINAL_PHIS, features.fibre.n_lobes)
    shape = (layout.TABLE_ROWS, layout.MARGINAL_PARTS, *of_row)
    out = memory.allocate("sums", 4 * int(np.prod(shape)))
    kernel = program.kernel_of(
        program.build(device, "prepare/marginals.cl", features), "marginal_densities"
    )
    whole = _packed(packed, np.zeros((layout.TABLE_ROWS, *of_row), np.float32))
    material = index_checks.upload(memory, "material", whole, features.debug)
    checks = index_checks.IndexChecks(device.queue, features)
    checks.watch(material)
    kernel(device.queue, *fibre_grid(device, shape[0] * shape[1]), out, rows, material)
    checks.check("marginal_densities")
    return marginals_from_sums(memory.read(out, shape))
