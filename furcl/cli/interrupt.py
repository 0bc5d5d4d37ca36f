"""What Ctrl-C and the signals that end programs do to a command that takes long."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import typer

from furcl.errors import FurclError

log = logging.getLogger(__name__)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupt:
    """Set by the first signal; the second one ends the program at once.

    Attributes
    ----------
    says : str                  what is said then
    signal : int or None        the signal that came first
    """

    signal: int | None = None

    def __init__(self, says: str) -> None:
        self.says = says

    @property
    def requested(self) -> bool:
        """Whether a signal came."""
        return self.signal is not None

    def exit(self) -> typer.Exit:
        """What to raise at the end: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP."""
        return typer.Exit(128 + (self.signal or 0))

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        for each in SIGNALS:
            if signal.getsignal(each) is self:
                # No exception: it could come up anywhere, and threads that are left abort.
                signal.signal(each, signal.SIG_DFL)
        log.warning("%s (Ctrl-C again: quit now)", self.says)


@contextmanager
def interruptible(
    says: str = "stopping; what is rendered will be written",
) -> Iterator[Interrupt]:
    """Let signals set an `Interrupt`, which the block asks for; those that are ignored stay so.

    Errors of furcl that an interrupt brings with it end the command as the interrupt does.
    """
    interrupt = Interrupt(says)
    caught = [each for each in SIGNALS if signal.getsignal(each) is not signal.SIG_IGN]
    before = {each: signal.signal(each, interrupt) for each in caught}
    with _own_thread(caught):
        try:
            yield interrupt
        except FurclError as error:
            if not interrupt.requested:
                raise
            log.warning("stopped before there were samples, nothing is written (%s)", error)
            raise interrupt.exit() from None
        finally:
            for each, handler in before.items():
                signal.signal(each, handler)


@contextmanager
def _own_thread(caught: list[signal.Signals]) -> Iterator[None]:
    """Have a thread of its own receive signals; this one, and threads that it starts, block them.

    A terminal sends Ctrl-C to the linker too that an OpenCL runtime has started. Blocked signals
    are inherited, so the linker goes on, and the runtime does not fail.
    """
    done = threading.Event()
    receiver = threading.Thread(target=done.wait, name="signals", daemon=True)
    receiver.start()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, caught)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        done.set()
        receiver.join()
