"""Self-test of an OpenCL device: every feature that the kernels use, compared with numpy.

`python -m furcl.device.selftest P:D` tests device D of platform P; it ends with code 0, or prints
what fails and ends with verdict.EXIT_FAILED. `furcl.device.verdict` runs it so, in a process of its
own, because some runtimes abort.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pyopencl as cl

from furcl.device import layout, program
from furcl.device.choice import Device, find_candidate, open_candidate
from furcl.device.features import Features
from furcl.device.random_numbers import independent_bits, sobol_bits
from furcl.device.verdict import EXIT_FAILED
from furcl.errors import DeviceError, FurclError, LayoutError

N_ITEMS = 1024
GROUP = 64


def _input(device: Device, array: np.ndarray) -> cl.Buffer:
    flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
    return cl.Buffer(device.context, flags, hostbuf=array)


def _output(device: Device, array: np.ndarray) -> cl.Buffer:
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    return cl.Buffer(device.context, flags, hostbuf=array)


def _read(device: Device, buffer: cl.Buffer, like: np.ndarray) -> np.ndarray:
    result = np.empty_like(like)
    cl.enqueue_copy(device.queue, result, buffer)
    return result


def _require(what: str, good: bool | np.bool_) -> None:
    if not good:
        raise DeviceError(f"{what}: the device computes something else than numpy")


def _test_vectors(device: Device, kernels: cl.Program) -> None:
    x = np.linspace(0.0, 8.0, 8 * N_ITEMS, dtype=np.float32)
    out = _output(device, np.zeros_like(x))
    kernels.selftest_vectors(device.queue, (N_ITEMS,), None, _input(device, x), out)
    v = x.astype(np.float64).reshape(-1, 8)
    wave = np.sin(v) * np.cos(v) + np.exp(-v) / np.sqrt(1 + v * v)
    expected = np.clip(np.where(v > 2, np.log1p(v), wave), -4, 4)[:, ::-1].ravel()
    _require("float8 arithmetic", np.allclose(_read(device, out, x), expected, 1e-5, 1e-5))


def _test_wide(device: Device, kernels: cl.Program) -> None:
    x = (np.arange(16 * N_ITEMS) * 7 % 256).astype(np.uint8)
    expected = 0.5 * x.astype(np.float32) - np.float32(0.5)
    out = _output(device, np.zeros_like(expected))
    kernels.selftest_wide(device.queue, (N_ITEMS,), None, _input(device, x), out)
    _require("float16 in functions", np.array_equal(_read(device, out, expected), expected))


def _test_scalars(device: Device, kernels: cl.Program) -> None:
    x = np.linspace(0.0, 8.0, N_ITEMS, dtype=np.float32)
    floats, words = np.zeros_like(x), np.zeros(N_ITEMS, np.uint32)
    y, z = _output(device, floats), _output(device, words)
    kernels.selftest_scalars(device.queue, (N_ITEMS,), None, _input(device, x), y, z)
    u = x / (1.0 + x.astype(np.float64))
    expected = np.arcsin(u) + np.arctan2(u, 2) + (1 + u) ** 0.3 - np.expm1(-u) - u
    _require("float functions", np.allclose(_read(device, y, floats), expected, 1e-5, 1e-5))
    integers = [
        32 - i.bit_length() + i.bit_count() + (i * 0x9E3779B9 >> 32) + int(bits)
        for i, bits in enumerate(x.view(np.uint32))
    ]
    found = _read(device, z, words)
    _require("integer functions", np.array_equal(found, np.array(integers) % 2**32))


def _test_queue(device: Device, kernels: cl.Program) -> None:
    flags = (np.arange(N_ITEMS, dtype=np.uint32) * 7 % 3 == 0).astype(np.uint32)
    kept = _output(device, np.zeros_like(flags))
    count = _output(device, np.zeros(1, np.uint32))
    group = min(GROUP, device.cl_device.max_work_group_size)
    kernels.selftest_queue(device.queue, (N_ITEMS,), (group,), _input(device, flags), kept, count)
    n_kept = int(_read(device, count, flags[:1])[0])
    _require("atomic counters", n_kept == flags.sum())
    found = np.sort(_read(device, kept, flags)[:n_kept])
    _require("local memory and barriers", np.array_equal(found, np.flatnonzero(flags)))


def _test_random(device: Device, kernels: cl.Program) -> None:
    seed, index = 20240229, np.arange(N_ITEMS)
    numbers = np.zeros((N_ITEMS, 4), np.float32)
    out = _output(device, numbers)
    kernels.selftest_random(device.queue, (N_ITEMS,), None, np.uint32(seed), out)
    bits = independent_bits(seed, index, 2 * index, 3) >> 8
    found = _read(device, out, numbers)
    _require("Philox random numbers", np.array_equal(found, (bits / 2.0**24).astype(np.float32)))


def _test_sobol(device: Device, kernels: cl.Program) -> None:
    seed, index = 20240229, np.arange(N_ITEMS)
    points = np.zeros((N_ITEMS, 4), np.uint32)
    out = _output(device, points)
    kernels.selftest_sobol(device.queue, (N_ITEMS,), None, np.uint32(seed), out)
    expected = sobol_bits(seed, index, index * index, 3)
    _require("Sobol points", np.array_equal(_read(device, out, points), expected))


def _test_structs(device: Device, kernels: cl.Program) -> None:
    given = np.zeros((), layout.struct_dtype("Example"))
    for n, (field, _) in enumerate(layout.STRUCTS["Example"]):
        given[field] = n + 1
    fields = given.dtype.fields or {}
    offsets = [place[1] for place in fields.values()]
    words = np.zeros(1 + len(fields) + given.nbytes // 4, np.uint32)
    out = _output(device, words)
    try:
        kernels.selftest_struct(device.queue, (1,), None, out, given)
    except cl.LogicError as error:  # some drivers compare the sizes themselves
        raise LayoutError(
            f"the device lays a struct out in other than the host's {given.nbytes} bytes "
            f"({error}); furcl allows no padding: report this device"
        ) from error
    found = _read(device, out, words)
    expected = np.array([given.nbytes, *offsets, *np.frombuffer(given.tobytes(), np.uint32)])
    if not np.array_equal(found, expected):
        raise LayoutError(
            f"the device lays a struct out as {found.tolist()} (size, field offsets, content), the "
            f"host as {expected.tolist()}; furcl allows no padding: report this device"
        )


TESTS: tuple[Callable[[Device, cl.Program], None], ...] = (
    _test_vectors,
    _test_wide,
    _test_scalars,
    _test_queue,
    _test_random,
    _test_sobol,
    _test_structs,
)


def run(device: Device) -> None:
    """Run every self-test on an opened device.

    Raises
    ------
    KernelBuildError, DeviceError, LayoutError     what fails first
    """
    kernels = program.build(device, "tools/selftest.cl", Features())
    for test in TESTS:
        test(device, kernels)


def main(arguments: list[str]) -> int:
    """Test the device that the one argument "P:D" names; print the reason of a failure."""
    try:
        run(open_candidate(find_candidate(arguments[0])))
    except (FurclError, cl.Error) as error:
        print(error)
        return EXIT_FAILED
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
