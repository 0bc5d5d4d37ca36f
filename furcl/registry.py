"""Things that scenes and settings name: those that come with furcl, and a user's own."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Generic, TypeVar

from furcl.errors import FurclError
from furcl.files import read_text

T = TypeVar("T")


class Registry(Generic[T]):
    """Things of one sort by name. furcl's own come first and are neither replaced nor removed."""

    def __init__(self, what: str, error: type[FurclError], built_in: Mapping[str, T]) -> None:
        """
        Parameters
        ----------
        what : str              a thing in messages, e.g. "light"
        error : type            what the methods raise
        built_in : dict         furcl's own
        """
        self.what = what
        self.error = error
        self.built_in = tuple(built_in)
        self._things = dict(built_in)

    def names(self) -> tuple[str, ...]:
        """All names, furcl's own first."""
        return tuple(self._things)

    def things(self) -> dict[str, T]:
        """A copy of all, by name."""
        return dict(self._things)

    def find(self, name: str, asked: str, register: str) -> T:
        """The thing of a name.

        Parameters
        ----------
        asked : str         how a message begins, up to the list of names
        register : str      public function that adds one

        Raises
        ------
        self.error          unknown name, with the nearest one or how to add it
        """
        if name in self._things:
            return self._things[name]
        near = difflib.get_close_matches(name, self._things, 1, 0.5)
        remedy = f"did you mean {near[0]!r}?" if near else f"{register} adds one"
        raise self.error(f"{asked} {', '.join(self._things)}; {remedy}")

    def check_name(self, name: str) -> None:
        """Refuse a name that `add` does not take.

        Raises
        ------
        self.error          an empty name, or one of furcl's own
        """
        if not name or name in self.built_in:
            reason = "one of furcl's own" if name else "empty"
            raise self.error(
                f"{self.what} {name!r}: the name is {reason}; the name must not be empty or one of "
                f"{', '.join(self.built_in)}; choose another"
            )

    def check_header(self, name: str, header: Path, functions: Sequence[str], see: str) -> set[str]:
        """Refuse a header of OpenCL C that cannot be read or lacks a function.

        Parameters
        ----------
        name : str          of the thing
        header : path       absolute
        functions : names   that it must have as whole words; where an included file defines them, a
                            comment may name them
        see : str           page or file that says what they are

        Returns
        -------
        set of str          all words of the header

        Raises
        ------
        self.error
        """
        try:
            text = read_text(header)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is not UTF-8"
            raise self.error(
                f"{self.what} {name!r}: {header} cannot be read: {reason}; register it with the "
                f"path of its file"
            ) from None
        words = set(re.findall(r"\w+", text))
        missing = [function for function in functions if function not in words]
        if missing:
            raise self.error(
                f"{self.what} {name!r}: {header} does not define {' and '.join(missing)}; see {see}"
            )
        return words

    def add(self, name: str, thing: T) -> None:
        """Make a thing known under a name; one of that name is replaced. Raises as `check_name`."""
        self.check_name(name)
        self._things[name] = thing

    def remove(self, name: str) -> None:
        """Forget a thing that was added; `self.error` if there is none of that name."""
        if name in self.built_in or name not in self._things:
            raise self.error(f"{self.what} {name!r} was not registered; nothing to remove")
        del self._things[name]
