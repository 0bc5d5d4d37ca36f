"""What a file of strands says of its units and its axes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Units:
    """Units and axes of a groom, as far as its file says.

    Attributes
    ----------
    metres : float or None      length of a unit [m]
    up_axis : str or None       "x", "y" or "z"
    """

    metres: float | None = None
    up_axis: str | None = None

    def scaled(self, factor: float) -> Units:
        """The units after all lengths have been multiplied by a factor."""
        return Units(None if self.metres is None else self.metres / factor, self.up_axis)

    def __str__(self) -> str:
        length = "not in the file" if self.metres is None else f"{self.metres:g} m"
        up = "up not in the file" if self.up_axis is None else f"{self.up_axis} up"
        return f"{length}, {up}"


NO_UNITS = Units()
"""Of a file that says neither."""
