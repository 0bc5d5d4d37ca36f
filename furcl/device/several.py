"""Several devices by name: "all", or names with commas between, which names may have too."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence

from furcl.device.choice import (
    Candidate,
    Device,
    list_candidates,
    match,
    open_candidate,
    open_device,
)
from furcl.errors import DeviceError
from furcl.values import shown

log = logging.getLogger(__name__)


def split_names(specs: str, candidates: Sequence[Candidate]) -> list[str]:
    """The names of devices in text with commas between.

    A comma may be part of a description: what names a device with its commas is one name.

    Parameters
    ----------
    specs : str                     as `open_devices` takes it
    candidates : list               the devices there are

    Returns
    -------
    list of str     "" for each place where nothing is between commas
    """
    parts, names = [part.strip() for part in specs.split(",")], []
    if all(re.fullmatch(r"\d+(:\d+)?", part) for part in parts):
        return parts
    while parts:
        ends = range(len(parts), 1, -1)
        joined = (e for e in ends if all(parts[:e]) and match(candidates, ", ".join(parts[:e])))
        end = next(joined, 1)
        names.append(", ".join(parts[:end]))
        parts = parts[end:]
    return names


def names_several(spec: str) -> bool:
    """Whether `spec` stands for more than one device."""
    return spec == "all" or ("," in spec and len(split_names(spec, list_candidates())) > 1)


def open_devices(specs: str | Sequence[str | Device]) -> list[Device]:
    """Open several devices.

    Parameters
    ----------
    specs : text or list    "all", those that pass the self-test, in the order of RULE; or names as
                            `open_device` takes them, with commas between or in a list; a list may
                            hold opened devices too

    Raises
    ------
    NoDeviceError, DeviceError      as `open_device`; a device that is named twice; none named
    """
    if specs == "all":
        passed = [c for c in list_candidates() if c.verdict().passed]
        if not passed:
            return [open_device("")]
        log.info(
            "devices: %s", "; ".join(c.description for c in sorted(passed, key=Candidate.rank))
        )
        return [open_candidate(c) for c in sorted(passed, key=Candidate.rank)]
    wanted = split_names(specs, list_candidates()) if isinstance(specs, str) else list(specs)
    if not wanted or "" in wanted:
        raise DeviceError(
            f'devices = {shown(specs)}: expected "all", or numbers of `furcl devices`, P:D or '
            f"parts of names, with commas between"
        )
    opened = [one if isinstance(one, Device) else open_device(one) for one in wanted]
    addresses = [device.cl_device.int_ptr for device in opened if device not in wanted]
    if len(set(addresses)) < len(addresses):
        raise DeviceError(f"devices = {shown(specs)}: names one device twice; name each once")
    return opened
