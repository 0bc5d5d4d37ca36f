"""The Embree 4 library inside the embreex wheel, bound with ctypes: loading, checks, trees.

The Python classes of embreex know triangles only; the shared library that they come with exports
the whole C interface, and with it the general tree builder that is used here (rtcBuildBVH).
"""

import ctypes
import functools
import importlib.util
import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.bvh.embree_callbacks import ROOT, compiled
from furcl.errors import BvhError

VERSION_MAJOR = 4
DEVICE_PROPERTY_VERSION = 0
BUILD_QUALITY_MEDIUM = 1

c_pointer, c_uint, c_float, c_size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_float, ctypes.c_size_t


class BuildArguments(ctypes.Structure):
    """RTCBuildArguments of rtcore_builder.h."""

    _fields_ = [
        ("byte_size", c_size),
        ("quality", ctypes.c_int),
        ("flags", ctypes.c_int),
        ("max_branching_factor", c_uint),
        ("max_depth", c_uint),
        ("sah_block_size", c_uint),
        ("min_leaf_size", c_uint),
        ("max_leaf_size", c_uint),
        ("traversal_cost", c_float),
        ("intersection_cost", c_float),
        ("bvh", c_pointer),
        ("primitives", c_pointer),
        ("primitive_count", c_size),
        ("primitive_capacity", c_size),
        ("create_node", c_pointer),
        ("set_node_children", c_pointer),
        ("set_node_bounds", c_pointer),
        ("create_leaf", c_pointer),
        ("split_primitive", c_pointer),
        ("progress", c_pointer),
        ("user", c_pointer),
    ]


#: RTCBuildPrimitive: the box of one primitive and its number.
PRIMITIVE = np.dtype(
    [("lower", "<f4", 3), ("geometry", "<u4"), ("upper", "<f4", 3), ("primitive", "<u4")]
)

STRUCT_BYTES = {"RTCBuildArguments": 136, "RTCBuildPrimitive": 32}


def _package_folder():
    spec = importlib.util.find_spec("embreex")
    if spec is None or not spec.submodule_search_locations:
        raise BvhError(
            "BVH builder: the package embreex is not installed; furcl needs it to build trees; "
            "run `pip install embreex`"
        )
    return pathlib.Path(spec.submodule_search_locations[0]).parent


def find_libraries(folder):
    """Paths of the TBB and Embree libraries that the embreex wheel puts into `folder`.

    Raises
    ------
    BvhError    if one is not there
    """
    found = []
    for pattern in ("libtbb*.so*", "libembree4*.so*"):
        matches = sorted((folder / "embreex.libs").glob(pattern))
        if not matches:
            raise BvhError(
                f"BVH builder: no {pattern} in {folder / 'embreex.libs'}; the Linux wheel of "
                "embreex 4.4 holds one: `pip install --force-reinstall embreex`"
            )
        found.append(matches[0])
    return found


def check_version(version, path):
    """Refuse an Embree whose structs may differ; `version` is 10000 major + 100 minor + patch."""
    if version // 10000 != VERSION_MAJOR:
        raise BvhError(
            f"{path}: Embree {version // 10000}.{version // 100 % 100} found; furcl is written for "
            f"the binary interface of Embree {VERSION_MAJOR}.x; install embreex 4.4"
        )


def check_struct_sizes(sizes):
    """Refuse struct sizes (name to bytes) other than those of Embree 4."""
    for name, expected in STRUCT_BYTES.items():
        if sizes[name] != expected:
            raise BvhError(
                f"Embree binding: {name} has {sizes[name]} bytes on this platform, {expected} are "
                "expected; only 64-bit Linux is supported"
            )


def load():
    """Make ready what the first tree would wait for otherwise.

    Raises
    ------
    BvhError    as `library`
    """
    library()
    compiled()


@functools.cache
def library():
    """Load Embree once and return it with the argument types set.

    Raises
    ------
    BvhError    if the library is missing, has another major version or another struct layout
    """
    tbb, embree = find_libraries(_package_folder())
    try:
        ctypes.CDLL(str(tbb), mode=ctypes.RTLD_GLOBAL)
        lib = ctypes.CDLL(str(embree))
    except OSError as error:
        raise BvhError(
            f"{embree}: cannot be loaded ({error}); reinstall embreex on 64-bit Linux"
        ) from error
    for name, result, arguments in (
        ("rtcNewDevice", c_pointer, [ctypes.c_char_p]),
        ("rtcGetDeviceProperty", ctypes.c_ssize_t, [c_pointer, ctypes.c_int]),
        ("rtcGetDeviceError", ctypes.c_int, [c_pointer]),
        ("rtcGetDeviceLastErrorMessage", ctypes.c_char_p, [c_pointer]),
        ("rtcReleaseDevice", None, [c_pointer]),
        ("rtcNewBVH", c_pointer, [c_pointer]),
        ("rtcBuildBVH", c_pointer, [ctypes.POINTER(BuildArguments)]),
        ("rtcReleaseBVH", None, [c_pointer]),
        ("rtcNewScene", c_pointer, [c_pointer]),
        ("rtcNewGeometry", c_pointer, [c_pointer, ctypes.c_int]),
        (
            "rtcSetSharedGeometryBuffer",
            None,
            [c_pointer, ctypes.c_int, c_uint, ctypes.c_int, c_pointer, c_size, c_size, c_size],
        ),
        ("rtcCommitGeometry", None, [c_pointer]),
        ("rtcAttachGeometry", c_uint, [c_pointer, c_pointer]),
        ("rtcReleaseGeometry", None, [c_pointer]),
        ("rtcCommitScene", None, [c_pointer]),
        ("rtcReleaseScene", None, [c_pointer]),
    ):
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    sizes = {
        "RTCBuildArguments": ctypes.sizeof(BuildArguments),
        "RTCBuildPrimitive": PRIMITIVE.itemsize,
    }
    check_struct_sizes(sizes)
    device = lib.rtcNewDevice(None)
    check_version(lib.rtcGetDeviceProperty(device, DEVICE_PROPERTY_VERSION), embree)
    lib.rtcReleaseDevice(device)
    return lib


class EmbreeDevice:
    """An Embree device, released when the object goes."""

    def __init__(self):
        self._library = library()
        self.handle = self._library.rtcNewDevice(None)
        if not self.handle:
            raise BvhError("Embree: no device could be made; is there memory left?")

    def check(self, action):
        """Raise BvhError if the last call on this device failed; ``action`` says what it was."""
        if self._library.rtcGetDeviceError(self.handle):
            text = self._library.rtcGetDeviceLastErrorMessage(self.handle) or b"unknown error"
            raise BvhError(f"Embree failed to {action}: {text.decode()}")

    def __del__(self):
        if getattr(self, "handle", None):
            self._library.rtcReleaseDevice(self.handle)


@dataclass(frozen=True, eq=False)
class BinaryTree:
    """A tree with one primitive a leaf; leaves are numbered from left to right.

    Attributes
    ----------
    nodes : (m, 4) int32        two children, each the index of a node or the complement of the
                                number of a leaf; the first and the last leaf below; 0 is the root
    heights : (m,) uint8        1 + that of the higher child, leaves having 0
    """

    nodes: NDArray[np.int32]
    heights: NDArray[np.uint8]


def build_binary_tree(primitives: NDArray) -> BinaryTree:
    """Build a binary tree with one primitive a leaf by Embree's binned SAH builder.

    Parameters
    ----------
    primitives : (n,) PRIMITIVE     boxes; reordered in place: primitives[i] becomes leaf i. A
                                    single one makes a node with it on both sides.

    Returns
    -------
    BinaryTree      of max(n - 1, 1) nodes. Which node has which index, the root apart, depends on
                    the timing of threads; the tree does not.

    Raises
    ------
    BvhError    if Embree cannot be used or fails
    """
    n = len(primitives)
    nodes, heights = np.empty((max(n - 1, 1), 4), np.int32), np.empty(max(n - 1, 1), np.uint8)
    if n == 1:
        nodes[0], heights[0] = (~0, ~0, 0, 0), 1
        return BinaryTree(nodes, heights)
    lib, device, callbacks = library(), EmbreeDevice(), compiled()
    addresses = [array.ctypes.data for array in (primitives, nodes, heights)]
    state = np.array([0, *addresses], np.int64)
    bvh = lib.rtcNewBVH(device.handle)
    arguments = BuildArguments(
        byte_size=ctypes.sizeof(BuildArguments),
        quality=BUILD_QUALITY_MEDIUM,
        max_branching_factor=2,
        max_depth=128,
        sah_block_size=1,
        min_leaf_size=1,
        max_leaf_size=1,
        traversal_cost=1.0,
        intersection_cost=1.0,
        bvh=bvh,
        primitives=primitives.ctypes.data,
        primitive_count=n,
        primitive_capacity=n,
        create_node=callbacks.create_node,
        set_node_children=callbacks.set_node_children,
        set_node_bounds=callbacks.set_node_bounds,
        create_leaf=callbacks.create_leaf,
        user=state.ctypes.data,
    )
    try:
        root = lib.rtcBuildBVH(ctypes.byref(arguments))
        device.check("build a tree")
    finally:
        lib.rtcReleaseBVH(bvh)
    if root != ROOT or state[0] != n - 1:
        raise BvhError(f"Embree built {state[0]} nodes for {n} boxes, {n - 1} are expected")
    return BinaryTree(nodes, heights)
