"""Choice of the OpenCL device that furcl computes on."""

from __future__ import annotations

import dataclasses
import logging
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

import pyopencl as cl

from furcl.device import crashes
from furcl.device import verdict as _verdict
from furcl.device.absence import pocl_cache_problem
from furcl.device.forks import check_process, mark_used
from furcl.device.runtime_caches import POCL, cache_of
from furcl.errors import DeviceError, NoDeviceError
from furcl.memory import little_address_space
from furcl.values import shown

log = logging.getLogger(__name__)

RULE = "a GPU before a CPU, then the highest driver version that passes the self-test"
_KINDS = ("GPU", "CPU", "other")


@dataclass(frozen=True, eq=False)
class Device:
    """An opened OpenCL device: one context and one profiling command queue.

    Attributes
    ----------
    context, queue : pyopencl.Context, pyopencl.CommandQueue
    name, platform, driver_version : str   as the runtime reports them
    is_cpu : bool                          True for CPU runtimes
    """

    context: cl.Context
    queue: cl.CommandQueue
    name: str
    platform: str
    driver_version: str
    is_cpu: bool

    @property
    def cl_device(self) -> cl.Device:
        """The pyopencl device."""
        return self.context.devices[0]

    @property
    def max_allocation_bytes(self) -> int:
        """The largest single buffer that the runtime allows [bytes]."""
        return int(self.cl_device.max_mem_alloc_size)


@dataclass(frozen=True)
class Candidate:
    """A device that a runtime offers, not opened yet.

    Attributes
    ----------
    index : int             place in the list of all devices
    address : str           "P:D", platform and device number
    name, runtime, runtime_version, driver_version : str   as the runtime reports them
    kind : str              "GPU", "CPU" or "other"
    compute_units : int     as the runtime counts them
    memory_bytes : int      global memory
    """

    index: int
    address: str
    name: str
    runtime: str
    runtime_version: str
    driver_version: str
    kind: str
    compute_units: int
    memory_bytes: int

    @property
    def description(self) -> str:
        """One line that tells this device from others."""
        return f"{self.name} ({self.runtime}, driver {self.driver_version})"

    def verdict(self, *, fresh: bool = False) -> _verdict.Verdict:
        """Whether it passes the self-test; remembered unless `fresh`."""
        identity = f"{self.description}\n{self.runtime_version}\npyopencl {cl.VERSION_TEXT}"
        found = _verdict.of(self.address, identity, fresh=fresh)
        problem = None if found.passed or self.runtime != POCL else pocl_cache_problem()
        if problem:
            return dataclasses.replace(found, reason=": ".join(problem))
        cache = cache_of(self.runtime)
        if found.runtime_failed and cache:
            return dataclasses.replace(found, reason=f"{found.reason}; {cache.advice}")
        return found

    def rank(self) -> tuple[int, list[int], int]:
        """Sort key of RULE: smaller is better."""
        version = [-int(number) for number in re.findall(r"\d+", self.driver_version)]
        return _KINDS.index(self.kind), version, self.index


def _kind(device: cl.Device) -> str:
    if device.type & cl.device_type.GPU:
        return "GPU"
    return "CPU" if device.type & cl.device_type.CPU else "other"


def platform_names() -> list[str]:
    """The names of the runtimes that the loader finds, with devices or without."""
    try:
        return [platform.name.strip() for platform in cl.get_platforms()]
    except cl.Error:  # the loader's way of saying that there is none
        return []


def list_candidates() -> list[Candidate]:
    """Every device of every platform, usable or not, in the order of the runtimes.

    Raises
    ------
    DeviceError     in a process that was forked after OpenCL was used
    """
    check_process()
    mark_used()
    try:
        platforms = cl.get_platforms()
    except cl.Error:  # the loader's way of saying that there is none
        return []
    found: list[Candidate] = []
    for p, platform in enumerate(platforms):
        try:
            devices = platform.get_devices()
        except cl.Error:  # a platform without a device
            continue
        for d, device in enumerate(devices):
            found.append(
                Candidate(
                    index=len(found),
                    address=f"{p}:{d}",
                    name=device.name.strip(),
                    runtime=platform.name.strip(),
                    runtime_version=platform.version.strip(),
                    driver_version=device.driver_version.strip(),
                    kind=_kind(device),
                    compute_units=int(device.max_compute_units),
                    memory_bytes=int(device.global_mem_size),
                )
            )
    return found


def open_candidate(candidate: Candidate) -> Device:
    """Open a device without asking for its verdict."""
    platform, device = (int(number) for number in candidate.address.split(":"))
    return open_cl_device(cl.get_platforms()[platform].get_devices()[device])


def open_cl_device(device: cl.Device) -> Device:
    """Make the context and the queue of one pyopencl device."""
    check_process()
    mark_used()
    context = cl.Context([device])
    crashes.renew(device.platform.name.strip())
    queue = cl.CommandQueue(context, properties=cl.command_queue_properties.PROFILING_ENABLE)
    return Device(
        context=context,
        queue=queue,
        name=device.name.strip(),
        platform=f"{device.platform.name.strip()} {device.platform.version.strip()}",
        driver_version=device.driver_version.strip(),
        is_cpu=_kind(device) == "CPU",
    )


def match(candidates: Sequence[Candidate], spec: str) -> list[Candidate]:
    """The devices that `spec` names: a number of the list, "P:D", or part of a description."""
    if spec.isdecimal():
        return [c for c in candidates if c.index == int(spec)]
    if re.fullmatch(r"\d+:\d+", spec):
        return [c for c in candidates if c.address == spec]
    wanted = spec.lower()
    return [c for c in candidates if wanted in f"{c.description} {c.runtime_version}".lower()]


def find_candidate(spec: str) -> Candidate:
    """The first device that `spec` names, tested or not.

    Raises
    ------
    DeviceError     if there is none
    """
    found = match(list_candidates(), spec)
    if not found:
        raise DeviceError(f"no OpenCL device is called {spec!r}; `furcl devices` lists them")
    return found[0]


def choose(candidates: Sequence[Candidate], spec: str, asked_by: str) -> Candidate:
    """The best of the devices that `spec` names ("" names all), by RULE.

    Raises
    ------
    NoDeviceError   if there is no device at all, or none passes the self-test
    DeviceError     if `spec` names none, or only such as fail the self-test
    """
    if not candidates:
        problem = pocl_cache_problem() if POCL in platform_names() else None
        if problem:
            raise NoDeviceError(f"no OpenCL device: {': '.join(problem)}")
        raise NoDeviceError(
            "no OpenCL device: no runtime is installed, or the loader looks elsewhere. "
            "`furcl doctor` says why; `python -m furcl.install.provision` installs a CPU runtime"
        )
    named = match(candidates, spec) if spec else list(candidates)
    if not named:
        offered = "; ".join(f"{c.index}: {c.description}" for c in candidates)
        raise DeviceError(
            f"{asked_by} {spec!r} names no OpenCL device; there are {offered}. Give a number, "
            f"P:D or a part of a name"
        )
    failures = []
    for candidate in sorted(named, key=Candidate.rank):
        verdict = candidate.verdict()
        if verdict.passed:
            for failure in failures:
                log.info("passed over: %s", failure)
            return candidate
        failures.append(f"{candidate.description}: {verdict.reason}")
    error = DeviceError if spec else NoDeviceError
    raise error(
        "no OpenCL device passes the self-test: " + "; ".join(failures) + ". `furcl doctor` says "
        "more; `python -m furcl.install.provision` installs a CPU runtime"
    )


def open_device(spec: str | None = None) -> Device:
    """Open the device that `spec`, else FURCL_DEVICE, else RULE chooses; never asks.

    Parameters
    ----------
    spec : str or None      number in `furcl devices`, "P:D", or part of a name

    Raises
    ------
    NoDeviceError, DeviceError      as `choose`; DeviceError also for what is no text, and where
                                    the address space is limited to less than furcl needs
    """
    if spec is not None and not isinstance(spec, str):
        raise DeviceError(
            f"device = {shown(spec)}: expected text: a number of `furcl devices`, P:D, or a part "
            f"of a name"
        )
    problem = little_address_space()
    if problem:
        raise DeviceError(f"no device is opened: {problem}")
    from_environment = os.environ.get("FURCL_DEVICE", "")
    wanted, asked_by = (spec, "--device") if spec else (from_environment, "FURCL_DEVICE")
    candidates = list_candidates()
    chosen = choose(candidates, wanted, asked_by)
    why = f"{asked_by} {wanted!r}" if wanted else f"rule: {RULE}"
    log.info("device %d: %s; %s", chosen.index, chosen.description, why)
    return open_candidate(chosen)
