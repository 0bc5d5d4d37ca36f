"""How far a convergence run is, for the caller's progress function, which may end it."""

from __future__ import annotations

from furcl.bench.convergence_plan import Plan
from furcl.rendering.renderer import Progress


class StoppedError(Exception):
    """The caller's progress function asked for the end."""


class Counter:
    """Path samples done, over all scenes.

    Attributes
    ----------
    done, total : int       path samples
    stopped : bool          whether the end was asked for
    """

    def __init__(self, progress: Progress | None, plan: Plan) -> None:
        self.progress = progress
        self.done = 0
        self.stopped = False
        self.total = sum(
            (plan.samples_a_pixel() + plan.reference_spp) * s.film.width * s.film.height
            for s in plan.scenes
        )

    def forget(self, samples: int) -> None:
        """Take out of the total what need not be rendered."""
        self.total -= samples

    def __call__(self, done: int, total: int) -> bool:
        """Tell of a render of which so many samples are done; whether the end is asked for."""
        if self.progress is not None and self.progress(self.done + done, self.total):
            self.stopped = True
        if done == total:
            self.done += total
        return self.stopped
