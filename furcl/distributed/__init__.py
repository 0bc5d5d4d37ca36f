"""Renders that several devices or machines share: parts of the samples, merged as they come."""

from furcl.distributed.cluster import render
from furcl.distributed.devices import render_on

__all__ = ["render", "render_on"]
