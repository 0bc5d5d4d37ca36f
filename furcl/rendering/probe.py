"""The device functions that render, called on arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from furcl.device import program
from furcl.device.choice import Device, open_device
from furcl.device.features import Features
from furcl.device.launch import fibre_grid
from furcl.device.layout import Mode
from furcl.device.memory import Memory
from furcl.errors import FibreError, ResourceError
from furcl.fibre import samplers
from furcl.fibre.material import build_material
from furcl.fibre.model import FibreFeatures, model_of
from furcl.fibre.samplers import Sampler
from furcl.memory import available_bytes
from furcl.rendering.probe_arguments import (
    agreeing,
    check_seed,
    float4,
    limits,
    offsets,
    real_numbers,
    uniform_numbers,
    unit_directions,
)
from furcl.values import is_whole, shown

# Kernels measure h by the share of the fibre's width; here its density is per unit of h, and the
# width is 2.
_PER_UNIT_OF_H = 0.5

# Limits of h as narrow as this are one offset: kernels/include/fibre/offsets.clh.
KNOWN_OFFSET = 1e-6

# Work-items of a launch are counted in 32 bits, and bytes of an array by some drivers.
MOST = 1 << 27


class Probe:
    """Evaluate, pdf and sample of one fibre on a device, in float32.

    Directions are unit vectors in the fibre's frame (x = tangent, root to tip). wo is the known
    direction (to the camera), wi the other one. Nothing is divided by a cosine; values include the
    cosine of the rendering equation.

    Parameters
    ----------
    fibre : Fibre               or the parameters of another model
    sampling : str or Sampler   "uniform-h", "attenuation-cdf", "full-cdf", "all-lobes" or one's own
    device : str or Device      as for furcl.render
    residual : bool             with the lobe that holds TRRT and all later orders
    channels : int or None      force 3 channels for a grey fibre
    profiles : object or None   used instead of what the model prepares for the fibre
    features : FibreFeatures or None        compile for these instead of what the fibre needs
    light_sampling : bool       with what light samples need: `estimate_far_field`
    absorbs : (low, high)       with tables for a range of absorptions, in which that of the fibre
                                lies, as where strands or points have values
    mode : str                  "far"; "multiscale" draws h within limits, "near" at one offset: the
                                argument `within` of the methods says which

    Raises
    ------
    SamplerError    unknown sampling, or one that the mode does not take
    FibreError      arrays whose shapes do not agree or that hold no real numbers, directions that
                    are not unit vectors, h outside [-1, 1], a lobe that there is not, channels, a
                    seed or numbers outside their range
    ResourceError   more directions than fit into the memory
    DeviceError     no usable device
    """

    def __init__(
        self,
        fibre: Any,
        sampling: str | Sampler = "full-cdf",
        device: str | Device | None = None,
        residual: bool = False,
        channels: int | None = None,
        profiles: Any = None,
        features: FibreFeatures | None = None,
        light_sampling: bool = False,
        absorbs: tuple[float, float] | None = None,
        mode: Mode = "far",
    ) -> None:
        self.mode = mode
        self.fibre = fibre
        self.device = device if isinstance(device, Device) else open_device(device)
        self.sampler = sampling if isinstance(sampling, Sampler) else samplers.find(sampling)
        grey = model_of(fibre).is_grey(fibre)
        if channels not in (None, 3, *([1] if grey else [])) or isinstance(channels, bool):
            raise FibreError(
                f"probe: channels = {shown(channels)} - allowed are 3, and 1 for a grey fibre - "
                f"leave it out to have as many as the fibre needs"
            )
        needed = 1 if features is None and grey else 3
        self.memory = Memory(self.device)
        self.material = build_material(
            self.memory,
            fibre,
            Features(
                channels=channels or needed,
                light_sampling=light_sampling,
                absorption="constant" if absorbs is None else "given",
                mode=mode,
            ),
            self.sampler,
            residual=residual,
            fibre_features=features,
            profiles=profiles,
            absorbs=absorbs,
        )
        self.features = self.material.features
        self._program = program.build(
            self.device, "tools/probe.cl", self.features, {"FURCL_LANES": 1}
        )

    def __repr__(self) -> str:
        return f"<Probe: {self.material.model.name}, {self.sampler.name}, {self.device.name}>"

    @property
    def lobes(self) -> tuple[str, ...]:
        """Names of the lobes in the order of every lobe axis and index."""
        return self.material.lobes

    def attenuation(self, h: ArrayLike, theta_in: ArrayLike) -> np.ndarray:
        """A_p(h): the energy of every lobe.

        Parameters
        ----------
        h : (n,) or scalar          offset, in [-1, 1]
        theta_in : (n,) or scalar   inclination of wo [rad], in [-pi/2, pi/2]

        Returns
        -------
        (lobes, n, 3) float32       in the order of `lobes`, in [0, 1]
        """
        theta_in = real_numbers("theta_in", theta_in)
        h, theta_in = agreeing(h=np.atleast_1d(offsets(h)), theta_in=np.atleast_1d(theta_in))
        self._require_memory(h.size, 4 * 3 * (1 + len(self.lobes)))
        angles = np.stack([np.sin(theta_in), np.cos(theta_in)], 1).astype(np.float32)
        if not np.all(np.abs(theta_in) <= 0.5 * np.pi + 1e-6):
            raise FibreError(
                f"probe: theta_in goes from {np.min(theta_in)} to {np.max(theta_in)} - allowed is "
                f"-pi/2 to pi/2 - give radians from the plane across the fibre"
            )
        n, memory = h.size, Memory(self.device)
        out = memory.allocate("out", 4 * 3 * len(self.lobes) * n)
        self._run(
            "probe_attenuation",
            n,
            memory.upload("h", h.astype(np.float32)),
            memory.upload("theta", angles),
            out,
            np.uint32(n),
        )
        return memory.read(out, (len(self.lobes), n, 3))

    def evaluate(
        self, wo: ArrayLike, wi: ArrayLike, h: ArrayLike, lobe: int | None = None
    ) -> np.ndarray:
        """BCSDF value at offset h: sum of the lobes, or one of them.

        Parameters
        ----------
        wo, wi : (n, 3) or (3,)     unit directions
        h : (n,) or scalar          offset in [-1, 1]
        lobe : int or None          index into `lobes`; None for all

        Returns
        -------
        (n, 3) float32              [1/sr], >= 0
        """
        self._check_lobe(lobe)
        value, _, _ = self._evaluate(wo, wi, h, self._at(h))
        return value.sum(axis=0) if lobe is None else value[lobe]

    def pdf(
        self,
        wo: ArrayLike,
        wi: ArrayLike,
        h: ArrayLike,
        lobe: int | None = None,
        within: ArrayLike | None = None,
    ) -> np.ndarray:
        """Density with which `sample` returns (lobe, h, wi), or (h, wi) for lobe = None.

        `0.5 * evaluate(wo, wi, h, lobe) / pdf(wo, wi, h, lobe)` is the weight that `sample`
        returns: the half is the density of h over the width of the fibre. Within limits it is 1
        over their distance, and 1 at one offset, where no h is drawn.

        Parameters
        ----------
        within : (n, 2) or (2,)     limits of h, in other modes than "far"

        Returns
        -------
        (n,) float32    [1/sr per unit of h, or 1/sr at one offset]
        """
        self._check_lobe(lobe)
        _, pdf = self.evaluate_lobes(wo, wi, h, within)
        return pdf.sum(axis=0) if lobe is None else pdf[lobe]

    def offset_pdf(
        self, wo: ArrayLike, h: ArrayLike, within: ArrayLike | None = None
    ) -> np.ndarray:
        """Density with which `sample` chooses lobe and offset, (lobes, n) float32 [1 per unit of
        h]; at one offset the chances of lobes there."""
        return self._evaluate(wo, wo, h, within)[1]

    def direction_pdf(self, wo: ArrayLike, wi: ArrayLike, h: ArrayLike, lobe: int) -> np.ndarray:
        """Density with which a lobe at offset h chooses wi, (n,) float32 [1/sr]."""
        self._check_lobe(lobe)
        return self._evaluate(wo, wi, h, self._at(h))[2][lobe]

    def sample(
        self,
        wo: ArrayLike,
        n: int | None = None,
        seed: int = 0,
        numbers: ArrayLike | None = None,
        within: ArrayLike | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Draw lobes, offsets and directions as a render does.

        Parameters
        ----------
        wo : (n, 3) or (3,)     unit directions
        n : int or None         number of samples for a single wo
        seed : int              0..2^32-1
        numbers : (n, 2, 4) or None     use these uniform numbers of [0, 1) instead of drawing them:
                                        of lobe and offset, and of the direction
        within : (n, 2) or (2,)         limits of h, in other modes than "far"

        Returns
        -------
        wi : (n, 3) float32     unit directions; zero where no lobe carries light
        h : (n,) float32
        lobe : (n,) uint32      index into `lobes`; len(lobes) where no lobe carries light
        weight : (n, 3) float32 what the path's throughput is multiplied with
        pdf : (n,) float32      density of (lobe, h, wi) [1/sr per unit of h]
        """
        check_seed(seed)
        if n is not None and (not is_whole(n) or n < 0):
            raise FibreError(f"probe: n = {shown(n)} - allowed are whole numbers, 0 or more")
        wo = np.atleast_2d(unit_directions("wo", wo))
        if n is not None:
            if len(wo) not in (1, n):
                raise FibreError(
                    f"probe: n = {n} with {len(wo)} directions wo - allowed are one, or n"
                )
            wo = np.broadcast_to(wo, (n, 3))
        n = len(wo)
        self._require_memory(n, 16 + 40 + (0 if numbers is None else 32))
        if numbers is not None:
            numbers = uniform_numbers(numbers, n)
        bounds = self._limits(within, n)
        memory = Memory(self.device)
        outs = {
            name: memory.allocate(name, size * n)
            for name, size in [("wi", 16), ("h", 4), ("lobe", 4), ("weight", 12), ("pdf", 4)]
        }
        self._run(
            "probe_sample",
            n,
            memory.upload("wo", float4(wo)),
            *outs.values(),
            np.uint32(n),
            np.uint32(seed),
            np.uint32(numbers is not None),
            memory.upload("numbers", np.zeros(4) if numbers is None else numbers),
            within=bounds,
        )
        return (
            memory.read(outs["wi"], (n, 4))[:, :3],
            memory.read(outs["h"], n),
            memory.read(outs["lobe"], n, np.uint32),
            memory.read(outs["weight"], (n, 3)),
            _per_unit_of_h(bounds) * memory.read(outs["pdf"], n),
        )

    def estimate_far_field(
        self, wo: ArrayLike, wi: ArrayLike, seed: int = 0, within: ArrayLike | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """What a light sample in the direction wi is worth: one lobe at one h of its own.

        Parameters
        ----------
        wo, wi : (n, 3) or (3,)     unit directions
        seed : int                  0..2^32-1
        within : (n, 2) or (2,)     limits of h, in other modes than "far"

        Returns
        -------
        value : (n, 3) float32      [1/sr]; its mean is that of `evaluate` over h in [-1, 1], or
                                    within the limits
        pdf : (n,) float32          about the density of wi in `sample`, all lobes and h [1/sr]:
                                    weighs it against samples of the light

        Raises
        ------
        FibreError      a probe without light_sampling; directions that are not unit vectors
        """
        if not self.features.light_sampling:
            raise FibreError(
                "probe: estimate_far_field is not compiled in - make the Probe with "
                "light_sampling=True"
            )
        check_seed(seed)
        wo, wi = np.atleast_2d(unit_directions("wo", wo)), np.atleast_2d(unit_directions("wi", wi))
        rows, _ = agreeing(wo=np.arange(len(wo)), wi=np.arange(len(wi)))
        self._require_memory(rows.size, 2 * 16 + 16)
        n, memory = rows.size, Memory(self.device)
        value, pdf = memory.allocate("value", 12 * n), memory.allocate("pdf", 4 * n)
        self._run(
            "probe_towards",
            n,
            memory.upload("wo", float4(np.broadcast_to(wo, (n, 3)))),
            memory.upload("wi", float4(np.broadcast_to(wi, (n, 3)))),
            value,
            pdf,
            np.uint32(n),
            np.uint32(seed),
            within=self._limits(within, n),
        )
        return memory.read(value, (n, 3)), memory.read(pdf, n)

    def evaluate_lobes(
        self, wo: ArrayLike, wi: ArrayLike, h: ArrayLike, within: ArrayLike | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values (lobes, n, 3) and densities (lobes, n) of every lobe: `evaluate` and `pdf`."""
        value, joint, direction = self._evaluate(wo, wi, h, within)
        return value, joint * direction

    def _evaluate(
        self, wo: ArrayLike, wi: ArrayLike, h: ArrayLike, within: ArrayLike | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of every lobe: value, density of (lobe, h), density of wi given both."""
        wo, wi, h = (
            np.atleast_2d(unit_directions("wo", wo)),
            np.atleast_2d(unit_directions("wi", wi)),
            offsets(h),
        )
        rows, _, h = agreeing(wo=np.arange(len(wo)), wi=np.arange(len(wi)), h=np.atleast_1d(h))
        n = rows.size
        self._require_memory(n, 2 * 16 + 4 + 20 * len(self.lobes))
        wo, wi = np.broadcast_to(wo, (n, 3)), np.broadcast_to(wi, (n, 3))
        bounds = self._limits(within, n)
        memory, lobes = Memory(self.device), len(self.lobes)
        value = memory.allocate("value", 12 * lobes * n)
        joint, direction = (memory.allocate(name, 4 * lobes * n) for name in ("joint", "direction"))
        self._run(
            "probe_evaluate",
            n,
            memory.upload("wo", float4(wo)),
            memory.upload("wi", float4(wi)),
            memory.upload("h", h.astype(np.float32)),
            value,
            joint,
            direction,
            np.uint32(n),
            within=bounds,
        )
        return (
            memory.read(value, (lobes, n, 3)),
            _per_unit_of_h(bounds) * memory.read(joint, (lobes, n)),
            memory.read(direction, (lobes, n)),
        )

    def _check_lobe(self, lobe: int | None) -> None:
        if lobe is None or (is_whole(lobe) and 0 <= lobe < len(self.lobes)):
            return
        names = ", ".join(f"{i} {name}" for i, name in enumerate(self.lobes))
        raise FibreError(f"probe: lobe = {shown(lobe)} - allowed are {names}")

    def _require_memory(self, n: int, bytes_each: int) -> None:
        """Refuse n directions of so many bytes that they do not fit the memory."""
        # The arrays, what is uploaded of them, and buffers, which may lie in the same memory.
        needed, there = 3 * n * bytes_each, available_bytes()
        if n > MOST or needed > there:
            raise ResourceError(
                f"probe: {n} directions need {needed / 2**20:.0f} MiB, {there / 2**20:.0f} MiB are "
                f"available, and at most {MOST} are taken at once - ask for fewer"
            )

    def _limits(self, within: ArrayLike | None, n: int) -> np.ndarray | None:
        """The limits of h of n elements (n, 2); None where h is anywhere."""
        if within is None and self.mode == "far":
            return None
        return limits(within, self.mode, n)

    def _at(self, h: ArrayLike) -> np.ndarray | None:
        """Limits for what does not depend on them."""
        return None if self.mode == "far" else np.stack([np.atleast_1d(offsets(h))] * 2, 1)

    def _run(self, name: str, n: int, *arguments, within: np.ndarray | None = None) -> None:
        kernel = program.kernel_of(self._program, name)
        last = []
        if within is not None:
            last = [Memory(self.device).upload("within", within.astype(np.float32))]
        size = fibre_grid(self.device, n)
        kernel(self.device.queue, *size, *arguments, self.material.buffer, *last)


def _per_unit_of_h(within: np.ndarray | None) -> np.ndarray | float:
    """What makes a density of h relative to an even one a density per unit of h; at one offset
    there is none."""
    if within is None:
        return _PER_UNIT_OF_H
    width = within[:, 1] - within[:, 0]
    known = width < KNOWN_OFFSET
    return np.where(known, 1.0, 1.0 / np.where(known, 1.0, width)).astype(np.float32)
