"""The exceptions of furcl.

One class for each layer. Every message says where, what was found, what is allowed and what to do.
"""


class FurclError(Exception):
    """Base of all errors that furcl raises on bad input or a bad environment."""


class GroomError(FurclError):
    """A groom file or a set of curves that cannot be used."""


class FibreError(FurclError, ValueError):
    """A fibre parameter outside its range."""


class SamplerError(FurclError, ValueError):
    """A sampler that is not known, or cannot be registered."""


class LightError(FurclError, ValueError):
    """A light that is not known, or cannot be registered."""


class SceneError(FurclError):
    """A scene file, or a value in it, that cannot be used."""


class DeviceError(FurclError):
    """No usable OpenCL device, or one that fails its self-test."""


class NoDeviceError(DeviceError):
    """Nothing on this machine that furcl can compute on."""


class KernelBuildError(FurclError):
    """A kernel that does not compile."""


class KernelIndexError(FurclError):
    """An index outside its buffer, found by a debug build (FURCL_DEBUG=1)."""


class LayoutError(FurclError):
    """A struct whose layout on the device differs from the host's."""


class BvhError(FurclError):
    """The Embree library cannot be used, or a hierarchy that does not hold its segments."""


class MeshError(FurclError):
    """A mesh that cannot be read or used."""


class ImageError(FurclError):
    """An image file that cannot be read, written or compared."""


class CheckpointError(FurclError):
    """A render that cannot be kept or gone on with as asked."""


class BenchError(FurclError):
    """A benchmark that cannot be run as asked, or results that do not belong together."""


class ResourceError(FurclError):
    """A render that does not fit the memory of the device."""
