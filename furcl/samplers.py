"""Samplers of one's own: registered under a name, and checked before they are compared.

docs/own_sampler.md has an example.
"""

from furcl.fibre.samplers import BUILT_IN, Sampler, find, names, register, unregister
from furcl.oracle.sampler_check import SamplerCheck, check

__all__ = [
    "BUILT_IN",
    "Sampler",
    "SamplerCheck",
    "check",
    "find",
    "names",
    "register",
    "unregister",
]
