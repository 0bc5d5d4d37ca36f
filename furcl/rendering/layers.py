"""Layers of the film beside the picture: what kernels keep of them, and the channels they become.

docs/layers.md says what users get.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.device.features import Features
from furcl.device.layout import Fields, Layer
from furcl.device.memory import Memory, fill
from furcl.errors import SceneError
from furcl.groom.joined import Grooms
from furcl.image.cryptomatte import Cryptomatte, hash_bits
from furcl.image.size import strips

Array = NDArray[np.float32]

# Depth where nothing is met, of which mean and nearest mean nothing [unit]; as Blender has it.
NO_DEPTH = 1e10
# Whole numbers that float32 holds.
MOST_STRANDS = 1 << 24
# Ids of a pixel that are counted, twice as many as are written: one that comes late finds a place.
RANKS = 6
RANKED_IDS = 2 * RANKS
# What kernels/stages/first_hits.cl has in the place of a strand + 1 where no fibre is nearest.
_NO_STRAND = 0xFFFFFFFF

# Layers that are means over what camera rays meet -> numbers, and the EXR channels they are.
MEANS: dict[str, tuple[str, ...]] = {
    "depth": ("Z",),
    "position": ("P.X", "P.Y", "P.Z"),
    "normal": ("N.X", "N.Y", "N.Z"),
    "tangent": ("tangent.X", "tangent.Y", "tangent.Z"),
    "strand_u": ("strand_u",),
}
OF_FIBRES = ("tangent", "strand_u")  # means over fibres alone
NEAREST = ("strand", "groom")
CRYPTOMATTES = ("cryptomatte_strand", "cryptomatte_groom")
OF_LIGHT = ("albedo", "direct", "indirect", "lobes")


@dataclass(frozen=True)
class LayerPart:
    """The part of `Features` with the layers that a film has.

    Attributes
    ----------
    names : tuple of Layer
    lobes : tuple of str        of all fibre materials, where each is a layer
    """

    names: tuple[Layer, ...] = ()
    lobes: tuple[str, ...] = ()
    name: str = "film"
    header: Path = Path("film/layers.clh")

    @property
    def of_light(self) -> bool:
        """Whether there are some of scattered light."""
        return any(name in OF_LIGHT for name in self.names)

    @property
    def of_first_hits(self) -> bool:
        """Whether there are some of what camera rays meet."""
        return any(name not in (*OF_LIGHT, "samples") for name in self.names)

    def first_hit_sums(self) -> dict[str, int]:
        """Sum -> its place in those of a pixel, of stages/first_hits.cl."""
        names = ["HITS"]
        if any(name in OF_FIBRES for name in self.names):
            names.append("FIBRE_HITS")
        names += [layer.upper() for layer in MEANS if layer in self.names]
        return _places(names, lambda name: len(MEANS.get(name.lower(), "1")))

    def light_sums(self, channels: int) -> dict[str, int]:
        """Sum -> its place in those of a pixel, of stages/light_layers.cl."""
        names = [layer.upper() for layer in OF_LIGHT if layer in self.names]
        lobes = channels * (len(self.lobes) + 1)  # surfaces are the last
        return _places(names, lambda name: lobes if name == "LOBES" else channels)

    def defines(self) -> Mapping[str, int | str]:
        """Which layers there are, and places of sums; -1 for what there is not."""
        sums = self.first_hit_sums()
        light: dict[str, int | str] = {
            f"FURCL_SUM_{name}": f"{place} * FURCL_CHANNELS"
            for name, place in self.light_sums(1).items()
            if name != "END"
        }
        return {
            "FURCL_FIRST_HITS": int(self.of_first_hits),
            "FURCL_LIGHT_LAYERS": int(self.of_light),
            "FURCL_SPLIT_DIRECT": int(any(n in ("direct", "indirect") for n in self.names)),
            "FURCL_LOBE_LAYERS": f"{len(self.lobes)}u",
            "FURCL_NEAREST": int(any(n in NEAREST for n in self.names)),
            "FURCL_STRAND_IDS": int(any(n in (*NEAREST, "cryptomatte_strand") for n in self.names)),
            "FURCL_RANKED_IDS": f"{RANKED_IDS}u",
            "FURCL_FIRST_HIT_SUMS": sums.pop("END"),
            "FURCL_LIGHT_SUMS": f"({self.light_sums(1)['END']} * FURCL_CHANNELS)",
            **dict.fromkeys(
                (f"FURCL_SUM_{n.upper()}" for n in ("hits", "fibre_hits", *MEANS, *OF_LIGHT)), -1
            ),
            **{f"FURCL_SUM_{name}": place for name, place in sums.items()},
            **light,
            **{f"FURCL_LAYER_{name.upper()}": 1 for name in self.names},
        }

    def structs(self) -> Mapping[str, Fields]:
        """None."""
        return {}

    def as_dict(self) -> Mapping[str, Any]:
        """The names."""
        return {"film_layers": list(self.names)}


def _places(names: Sequence[str], width: Any) -> dict[str, int]:
    """Name -> where it begins when all stand in a row; END is how many numbers there are."""
    found, at = {}, 0
    for name in names:
        found[name] = at
        at += width(name)
    return {**found, "END": at}


class LayerBuffers:
    """The layers of a film on the device.

    Parameters
    ----------
    features : Features     with a part `layers`

    Raises
    ------
    ImageError      cryptomatte without the package that it needs

    Attributes
    ----------
    first_hits, light : Buffer or None      sums by pixel, float32 (sum, correction) each
    """

    def __init__(self, memory: Memory, n_pixels: int, features: Features) -> None:
        part = features.layers
        assert isinstance(part, LayerPart)
        if any(name in CRYPTOMATTES for name in part.names):
            hash_bits("")  # says before the render what is missing
        self._memory, self.part, self.features = memory, part, features
        self.n_pixels = n_pixels

        def allocate(wanted: bool, name: str, words: int) -> cl.Buffer | None:
            size = 4 * words * n_pixels
            return memory.allocate(f"layers: {name}", size, zero=True) if wanted else None

        names, channels = part.names, features.channels
        self.first_hits = allocate(
            part.of_first_hits, "first hits", 2 * part.first_hit_sums()["END"]
        )
        self.light = allocate(part.of_light, "light", 2 * part.light_sums(channels)["END"])
        self.nearest = allocate(any(n in NEAREST for n in names), "nearest", 2)
        ranks = {name: allocate(name in names, name, 2 * RANKED_IDS) for name in CRYPTOMATTES}
        self.ranks = {name: buffer for name, buffer in ranks.items() if buffer is not None}
        # Until `place`, something for kernels that are launched over nothing.
        defines = part.defines()
        self._ids: list[Any] = [self.first_hits] if defines["FURCL_STRAND_IDS"] else []
        self._grooms: list[Any] = (
            [self.first_hits, np.uint32(0), np.uint32(0)] if "cryptomatte_groom" in names else []
        )
        self._names: list[str] = []
        self._first_strands = np.zeros(1, np.int64)

    @property
    def buffers(self) -> list[cl.Buffer]:
        """All that samples are added to."""
        every = (self.first_hits, self.light, self.nearest, *self.ranks.values())
        return [buffer for buffer in every if buffer is not None]

    def parts(self) -> dict[str, cl.Buffer]:
        """All that samples are added to, by name, for checkpoints."""
        return {f"layers {i}": buffer for i, buffer in enumerate(self.buffers)}

    def clear(self, queue: cl.CommandQueue) -> None:
        """Take all samples back out."""
        for buffer in self.buffers:
            fill(queue, buffer, 0, buffer.size)

    def place(self, grooms: Grooms, surfaces: Sequence[str], lamps: Sequence[str] = ()) -> None:
        """Set what strands and objects are.

        Parameters
        ----------
        grooms : Grooms             as rays meet them
        surfaces : list of str      names of the surface and the meshes that rays meet
        lamps : list of str         names of the lamps that have a place, one a record

        Raises
        ------
        SceneError      more strands than whole numbers of float32
        """
        curves = grooms.curves
        if self.nearest and curves.n_strands > MOST_STRANDS:
            raise SceneError(
                f"film.layers has strand or groom: {curves.n_strands} strands; numbers up to "
                f"{MOST_STRANDS} fit a channel, take cryptomatte_strand instead"
            )
        self._first_strands = np.array([*grooms.first_strands, curves.n_strands])
        self._names = [*(groom.name for groom in grooms.grooms), *surfaces, *lamps]
        if self._ids:
            words = 32 * np.arange(-(-curves.n_points // 32))
            before = np.searchsorted(curves.offsets[1:] - 1, words).astype(np.uint32)
            self._ids = [self._memory.upload("layers: strands", before)]
        if self._grooms:
            starts = curves.offsets[grooms.first_strands].astype(np.uint32)
            uploaded = self._memory.upload("layers: grooms", starts)
            first_lamp = len(starts) + len(surfaces)
            self._grooms = [uploaded, np.uint32(len(starts)), np.uint32(first_lamp)]

    def first_hit_arguments(self) -> list[Any]:
        """Those of add_first_hits that are the layers' own, after the geometry."""
        strands = self.ranks.get("cryptomatte_strand")
        grooms = self.ranks.get("cryptomatte_groom")
        return [
            *self._ids,
            *([self.nearest] if self.nearest else []),
            *([strands] if strands else []),
            *([grooms, *self._grooms] if grooms else []),
        ]

    def read(self, samples: NDArray[np.uint32]) -> tuple[dict[str, Array], dict[str, str]]:
        """Channels by their EXR names, each (H, W) float32, and header attributes.

        Parameters
        ----------
        samples : (H, W) uint32     of each pixel
        """
        channels: dict[str, Array] = {}
        matted = {layer: self._matted(layer, samples.shape) for layer in self.ranks}
        attributes: dict[str, str] = {}
        for rows in strips(*samples.shape):
            found = self._channels(rows, samples[rows])
            for layer, names in matted.items():
                matte = self._cryptomatte(layer, names, rows, samples[rows])
                found |= matte.channels
                attributes |= matte.attributes
            for name, values in found.items():
                if name not in channels:
                    channels[name] = np.empty(samples.shape, np.float32)
                channels[name][rows] = values
        return channels, attributes

    def _channels(self, rows: slice, samples: NDArray[np.uint32]) -> dict[str, Array]:
        """Those of some rows that are no matte."""
        channels: dict[str, Array] = {}
        if self.first_hits:
            channels |= self._first_hit_channels(rows, samples)
        if self.light:
            channels |= self._light_channels(rows, samples)
        if self.nearest:
            channels |= self._nearest_channels(rows, samples.shape)
        if "samples" in self.part.names:
            channels["samples"] = samples.astype(np.float32)
        return channels

    def _read(
        self, buffer: cl.Buffer | None, rows: slice, shape: tuple[int, ...], kind: Any
    ) -> Any:
        """What a buffer has of some rows, (H, W, ...) of 4 bytes each."""
        assert buffer is not None
        offset = 4 * rows.start * int(np.prod(shape[1:]))
        return self._memory.read(buffer, shape, kind, offset=offset)

    def _sums(self, buffer: cl.Buffer | None, n: int, rows: slice, shape: tuple[int, ...]) -> Any:
        """Sums (n, H, W) of some rows."""
        pairs = self._read(buffer, rows, (*shape, n, 2), np.float32).astype(np.float64)
        return np.moveaxis(pairs[..., 0] - pairs[..., 1], 2, 0)

    def _first_hit_channels(self, rows: slice, samples: NDArray[np.uint32]) -> dict[str, Array]:
        places = self.part.first_hit_sums()
        sums = self._sums(self.first_hits, places["END"], rows, samples.shape)
        hits = sums[0]
        found: dict[str, Array] = {}
        with np.errstate(invalid="ignore", divide="ignore"):
            if "alpha" in self.part.names:
                found["A"] = np.nan_to_num(hits / samples).astype(np.float32)
            for layer, names in MEANS.items():
                if layer not in self.part.names:
                    continue
                of = sums[places["FIBRE_HITS"]] if layer in OF_FIBRES else hits
                nothing = NO_DEPTH if layer == "depth" else 0.0
                for i, name in enumerate(names):
                    mean = sums[places[layer.upper()] + i] / of
                    found[name] = np.where(of > 0.0, mean, nothing).astype(np.float32)
        return found

    def _light_channels(self, rows: slice, samples: NDArray[np.uint32]) -> dict[str, Array]:
        n = self.features.channels
        places = self.part.light_sums(n)
        sums = self._sums(self.light, places["END"], rows, samples.shape)
        layers = {
            layer: places[layer.upper()]
            for layer in ("albedo", "direct", "indirect")
            if layer in self.part.names
        }
        if "lobes" in self.part.names:
            names = [*(f"lobe_{lobe}" for lobe in self.part.lobes), "lobe_surface"]
            if not self.features.has_surfaces:
                names.pop()
            layers |= {name: places["LOBES"] + n * i for i, name in enumerate(names)}
        with np.errstate(invalid="ignore", divide="ignore"):
            return {
                f"{layer}.{c}": np.nan_to_num(sums[at + min(i, n - 1)] / samples).astype(np.float32)
                for layer, at in layers.items()
                for i, c in enumerate("RGB")
            }

    def _nearest_channels(self, rows: slice, shape: tuple[int, ...]) -> dict[str, Array]:
        strand = self._read(self.nearest, rows, (*shape, 2), np.uint32)[..., 1].astype(np.int64)
        strand = np.where(strand == _NO_STRAND, 0, strand) - 1
        groom = np.searchsorted(self._first_strands, strand, side="right") - 1
        found = {"groom": groom, "strand": strand - self._first_strands[np.maximum(groom, 0)]}
        return {
            name: np.where(strand < 0, -1, values).astype(np.float32)
            for name, values in found.items()
            if name in self.part.names
        }

    def _ids_and_counts(self, layer: str, rows: slice, shape: tuple[int, ...]) -> Any:
        """Ids (H, W, RANKED_IDS) of some rows, -1 for none, and their samples."""
        pairs = self._read(self.ranks[layer], rows, (*shape, RANKED_IDS, 2), np.uint32)
        return pairs[..., 0].astype(np.int64) - 1, pairs[..., 1]

    def _matted(self, layer: str, shape: tuple[int, int]) -> dict[int, str]:
        """Id -> name of all that a matte shows."""
        found: list[NDArray[np.int64]] = []
        for rows in strips(*shape):
            ids = self._ids_and_counts(layer, rows, (rows.stop - rows.start, shape[1]))[0]
            found.append(np.unique(ids[ids >= 0]))
        used = np.unique(np.concatenate(found))
        if layer == "cryptomatte_groom":
            return {int(i): self._names[i] for i in used}
        grooms = np.searchsorted(self._first_strands, used, side="right") - 1
        own = used - self._first_strands[grooms]
        return {
            int(i): f"{self._names[groom]}/{strand}"
            for i, groom, strand in zip(used, grooms, own, strict=True)
        }

    def _cryptomatte(
        self, layer: str, names: dict[int, str], rows: slice, samples: NDArray[np.uint32]
    ) -> Cryptomatte:
        ids, counts = self._ids_and_counts(layer, rows, samples.shape)
        name = "CryptoObject" if layer == "cryptomatte_groom" else "CryptoStrand"
        return Cryptomatte.of(name, names, ids, counts, samples, RANKS)
