"""The device functions that render, called on arrays."""

from __future__ import annotations

import numpy as np
import pyopencl as cl

from furcl.device import program
from furcl.device.choice import Device, open_device
from furcl.device.features import LOBES, Features
from furcl.device.launch import grid
from furcl.device.memory import Memory
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles
from furcl.fibre.material import build_material, fibre_features


class Probe:
    """Evaluate, pdf and sample of one fibre on a device, in float32.

    Directions are unit vectors in the fibre's frame (x = tangent, root to tip). wo is the known
    direction (to the camera), wi the other one. Nothing is divided by a cosine; values include the
    cosine of the rendering equation.

    Parameters
    ----------
    fibre : Fibre
    sampling : str              "uniform-h", "attenuation-cdf" or "full-cdf"
    device : str or Device      as for furcl.render
    residual : bool             with the lobe TRRT+ as a sixth
    channels : int or None      force 3 channels for a grey fibre
    profiles : MedullaProfiles or None      used instead of those that the fibre's medulla has
    features : Features or None             compile for these instead of what the fibre needs

    Raises
    ------
    ValueError      unknown sampling, or arrays whose shapes do not agree
    DeviceError     no usable device
    """

    def __init__(
        self,
        fibre: Fibre,
        sampling: str = "full-cdf",
        device: str | Device | None = None,
        residual: bool = False,
        channels: int | None = None,
        profiles: MedullaProfiles | None = None,
        features: Features | None = None,
    ) -> None:
        self.fibre = fibre
        self.device = device if isinstance(device, Device) else open_device(device)
        if features is None:
            features = fibre_features(fibre, sampling=sampling, residual=residual)
        self.features = features if channels is None else features.with_(channels=channels)
        self.memory = Memory(self.device)
        self.material = build_material(self.memory, fibre, self.features, profiles=profiles)
        self._program = program.build(self.device, "tools/probe.cl", self.features)

    @property
    def lobes(self) -> tuple[str, ...]:
        """Names of the lobes in the order of every lobe axis and index."""
        return (*LOBES, "residual")[: self.features.n_lobes]

    def attenuation(self, h, theta_in) -> np.ndarray:
        """A_p(h): the energy of every lobe.

        Parameters
        ----------
        h : (n,) or scalar          offset, in [-1, 1]
        theta_in : (n,) or scalar   inclination of wo [rad], in [-pi/2, pi/2]

        Returns
        -------
        (lobes, n, 3) float32       in the order of `lobes`, in [0, 1]
        """
        h, theta_in = np.broadcast_arrays(np.atleast_1d(h), np.atleast_1d(theta_in))
        n = h.size
        angles = np.stack([np.sin(theta_in), np.cos(theta_in)], 1).astype(np.float32)
        memory = Memory(self.device)
        out = memory.allocate("out", 4 * 3 * self.features.n_lobes * n)
        self._run(
            "probe_attenuation",
            n,
            memory.upload("h", h.astype(np.float32)),
            memory.upload("theta", angles),
            out,
            np.uint32(n),
            self.material.params,
            self.material.profile_buffer,
        )
        return memory.read(out, (self.features.n_lobes, n, 3))

    def evaluate(self, wo, wi, h, lobe: int | None = None) -> np.ndarray:
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
        value, _ = self.evaluate_lobes(wo, wi, h)
        return value.sum(axis=0) if lobe is None else value[lobe]

    def pdf(self, wo, wi, h, lobe: int | None = None) -> np.ndarray:
        """Density with which `sample` returns (lobe, h, wi), or (h, wi) for lobe = None.

        `0.5 * evaluate(wo, wi, h, lobe) / pdf(wo, wi, h, lobe)` is the weight that `sample`
        returns: the half is the density of h over the width of the fibre.

        Returns
        -------
        (n,) float32    [1/sr per unit of h]
        """
        _, pdf = self.evaluate_lobes(wo, wi, h)
        return pdf.sum(axis=0) if lobe is None else pdf[lobe]

    def sample(self, wo, n: int | None = None, seed: int = 0, numbers=None):
        """Draw lobes, offsets and directions as a render does.

        Parameters
        ----------
        wo : (n, 3) or (3,)     unit directions
        n : int or None         number of samples for a single wo
        seed : int              0..2^32-1
        numbers : (n, 2, 4) or None     use these uniform numbers of [0, 1) instead of drawing them:
                                        of lobe and offset, and of the direction

        Returns
        -------
        wi : (n, 3) float32     unit directions; zero where no lobe carries light
        h : (n,) float32
        lobe : (n,) uint32      index into `lobes`; len(lobes) where no lobe carries light
        weight : (n, 3) float32 what the path's throughput is multiplied with
        pdf : (n,) float32      density of (lobe, h, wi)
        """
        wo = np.atleast_2d(np.asarray(wo, np.float64))
        if n is not None:
            wo = np.broadcast_to(wo, (n, 3))
        n = len(wo)
        if numbers is not None:
            numbers = np.asarray(numbers, np.float32).reshape(n, 2, 4)
        memory = Memory(self.device)
        outs = {
            name: memory.allocate(name, size * n)
            for name, size in [("wi", 16), ("h", 4), ("lobe", 4), ("weight", 12), ("pdf", 4)]
        }
        self._run(
            "probe_sample",
            n,
            memory.upload("wo", _float4(wo)),
            *outs.values(),
            np.uint32(n),
            np.uint32(seed),
            np.uint32(numbers is not None),
            memory.upload("numbers", np.zeros(4) if numbers is None else numbers),
            self.material.params,
            self.material.table_buffer,
            self.material.profile_buffer,
        )
        return (
            memory.read(outs["wi"], (n, 4))[:, :3],
            memory.read(outs["h"], n),
            memory.read(outs["lobe"], n, np.uint32),
            memory.read(outs["weight"], (n, 3)),
            memory.read(outs["pdf"], n),
        )

    def evaluate_lobes(self, wo, wi, h) -> tuple[np.ndarray, np.ndarray]:
        """Values (lobes, n, 3) and densities (lobes, n) of every lobe: `evaluate` and `pdf`."""
        wo, wi, h = np.atleast_2d(wo), np.atleast_2d(wi), np.atleast_1d(h)
        n = max(len(wo), len(wi), len(h))
        wo, wi = np.broadcast_to(wo, (n, 3)), np.broadcast_to(wi, (n, 3))
        h = np.broadcast_to(h, (n,))
        memory = Memory(self.device)
        lobes = self.features.n_lobes
        value = memory.allocate("value", 12 * lobes * n)
        pdf = memory.allocate("pdf", 4 * lobes * n)
        self._run(
            "probe_evaluate",
            n,
            memory.upload("wo", _float4(wo)),
            memory.upload("wi", _float4(wi)),
            memory.upload("h", h.astype(np.float32)),
            value,
            pdf,
            np.uint32(n),
            self.material.params,
            self.material.table_buffer,
            self.material.profile_buffer,
        )
        return memory.read(value, (lobes, n, 3)), memory.read(pdf, (lobes, n))

    def densities(
        self, lobe: int, theta_in, theta_out, phi, turned
    ) -> tuple[np.ndarray, np.ndarray]:
        """The two factors of the density of R, TT or TRT, each alone.

        Parameters
        ----------
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
        n = len(theta_in)
        memory = Memory(self.device)
        theta = np.stack([np.sin(theta_in), np.cos(theta_in)], 1).astype(np.float32)
        to = np.stack([np.sin(theta_out), np.cos(theta_out), phi, turned], 1).astype(np.float32)
        out = [memory.allocate(name, 4 * n) for name in ("longitudinal", "azimuthal")]
        self._run(
            "probe_densities",
            n,
            memory.upload("theta", theta),
            memory.upload("to", to),
            *out,
            np.uint32(n),
            np.uint32(lobe),
            self.material.params,
        )
        return memory.read(out[0], n), memory.read(out[1], n)

    def _run(self, name: str, n: int, *arguments) -> None:
        cl.Kernel(self._program, name)(self.device.queue, *grid(n), *arguments)


def _float4(vectors: np.ndarray) -> np.ndarray:
    out = np.zeros((len(vectors), 4), np.float32)
    out[:, :3] = vectors
    return out
