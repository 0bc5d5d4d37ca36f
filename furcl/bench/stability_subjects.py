"""The fibre models that `furcl bench stability` sweeps, by name."""

from __future__ import annotations

from importlib import import_module

from furcl.bench.stability_subject import Subject
from furcl.errors import BenchError

_SUBJECTS = {
    "double-cylinder": ("furcl.bench.stability_double_cylinder", "SUBJECT"),
    "chiang": ("furcl.bench.stability_cylinder", "CHIANG_SUBJECT"),
    "deon": ("furcl.bench.stability_cylinder", "DEON_SUBJECT"),
    "marschner": ("furcl.bench.stability_closed", "MARSCHNER_SUBJECT"),
    "sadeghi": ("furcl.bench.stability_closed", "SADEGHI_SUBJECT"),
    "yan2015": ("furcl.bench.stability_yan2015", "YAN2015_SUBJECT"),
}


def names() -> tuple[str, ...]:
    """All models that there is a sweep of."""
    return tuple(_SUBJECTS)


def find(name: str) -> Subject:
    """The subject of a model.

    Raises
    ------
    BenchError      there is none
    """
    if name not in _SUBJECTS:
        raise BenchError(
            f"--model {name}: there is no sweep of it - allowed are {', '.join(_SUBJECTS)}; of a "
            f"model of your own pass a Subject to furcl.bench.stability.run"
        )
    module, attribute = _SUBJECTS[name]
    return getattr(import_module(module), attribute)
