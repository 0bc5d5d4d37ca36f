"""Renders a scene on a thread of its own while pages change it."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, TypeVar

from furcl.device.choice import Device, open_device
from furcl.errors import FurclError, SceneError
from furcl.image.image import Image
from furcl.scene.tables import Scene
from furcl.scene.write import scene_text
from furcl.viewer import messages, telling
from furcl.viewer.lobes_thread import LobesThread
from furcl.viewer.messages import SlotName
from furcl.viewer.picture import Moments, encoded
from furcl.viewer.progressive import Progressive
from furcl.viewer.settings import Settings, changed_by
from furcl.viewer.telling import Kind

log = logging.getLogger(__name__)

T = TypeVar("T")

Listener = Callable[[Kind, str | bytes], None]
Asked = tuple[messages.Message, Listener | None]


@dataclass
class Slot:
    """One of the two settings, and the samples that it had when it was left."""

    settings: Settings
    kept: Moments | None = None


class Session:
    """The render thread, its two settings, and who listens.

    Methods may be called from any thread; listeners are called from the render thread and from
    that of the lobes.

    Parameters
    ----------
    scene : Scene
    device : str, Device or None    as for `furcl.render`

    Attributes
    ----------
    name : str                      of the scene
    ended : Event                   set when the thread has ended
    failure : Exception or None     why it ended, if not by `close`

    Raises
    ------
    DeviceError         no usable device
    """

    def __init__(self, scene: Scene, device: str | Device | None = None) -> None:
        self._device = device if isinstance(device, Device) else open_device(device)
        self.name = scene.name
        self._slots: dict[SlotName, Slot] = {n: Slot(Settings(scene, scene)) for n in ("A", "B")}
        self._slot: SlotName = "A"
        self._wake = threading.Condition()
        self._asked: list[Asked] = []
        self._calls: list[tuple[Callable[[], Any], Future[Any]]] = []
        self._closing = self._paused = False
        self._listeners: list[Listener] = []
        self._last: dict[Kind, str | bytes] = {}
        self.ended = threading.Event()
        self.failure: Exception | None = None
        self._revision = 0
        self._progressive = Progressive(self._device, self._pending, self._look_up)
        self._lobes = LobesThread(lambda text: self._tell("lobes", text))
        self._thread = threading.Thread(target=self._run, name="view")
        self._thread.start()

    # From any thread.

    def listen(self, listener: Listener) -> None:
        """Call a function with every message from here on, and with the last of each kind now."""
        with self._wake:
            self._listeners.append(listener)
            last = dict(self._last)
        for kind, message in last.items():
            listener(kind, message)

    def forget(self, listener: Listener) -> None:
        """Call a listener no more."""
        with self._wake:
            if listener in self._listeners:
                self._listeners.remove(listener)

    def ask(self, message: messages.Message, answer: Listener | None = None) -> None:
        """Have the thread do what a page asks for; `answer` takes errors, else all listeners."""
        with self._wake:
            self._asked.append((message, answer))
            self._wake.notify()

    def picture(self) -> Future[Image]:
        """The picture that is shown, with its statistics."""
        return self._call(lambda: self._progressive.image(self._settings))

    def scene_text(self) -> Future[str]:
        """The scene with all changes, as TOML."""
        return self._call(lambda: scene_text(self._settings.seen()))

    def close(self) -> None:
        """End the threads, and wait for them."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join()

    def _look_up(self) -> None:
        with self._wake:
            self._wake.notify()

    def _call(self, function: Callable[[], T]) -> Future[T]:
        future: Future[T] = Future()
        with self._wake:
            if self._closing:
                future.set_exception(SceneError("the view is closed; start it again"))
            else:
                self._calls.append((function, future))
                self._wake.notify()
        return future

    # From here on from the render thread.

    @property
    def _settings(self) -> Settings:
        return self._slots[self._slot].settings

    def _run(self) -> None:
        try:
            self._tell_state("setting up")
            self._progressive.follow(self._settings, None)
            self._show_again()
            while self._attend():
                if self._paused or not self._progressive.has_work:
                    continue
                if self._progressive.step():
                    self._tell_picture(self._slot)
                    self._show_lobes()
                if self._progressive.refined():
                    self._show_again()
        except Exception as failure:
            self.failure = failure
            self._tell("error", telling.error(failure, fatal=True))
            if not isinstance(failure, FurclError):
                log.exception("the view ended")
        finally:
            self._lobes.close()
            self._progressive.close()
            with self._wake:
                self._closing = True
                for _, future in self._calls:
                    future.cancel()
                self.ended.set()

    def _pending(self, *_: int) -> bool:
        """Whether a wave is to be the last one."""
        return bool(self._asked or self._calls or self._closing)

    def _attend(self) -> bool:
        """Do what was asked for since the last step, or wait for it if there is nothing else to do;
        false at the end."""
        with self._wake:
            while not self._pending() and (self._paused or not self._progressive.has_work):
                self._wake.wait()
            asked, self._asked = self._asked, []
            calls, self._calls = self._calls, []
            if self._closing:
                self._calls = calls
                return False
        for function, future in calls:
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(function())
                except Exception as error:
                    future.set_exception(error)
        for together in _groups(asked):
            self._take(together)
        return True

    def _take(self, asked: list[Asked]) -> None:
        """Do what was asked for, and have the picture follow once."""
        slot, settings = self._slot, self._settings
        for message, answer in asked:
            try:
                self._apply(message)
            except (FurclError, ValueError) as error:
                self._refuse(error, answer)
        if self._settings != settings or self._slot != slot:
            self._slots[slot].kept = None if self._slot == slot else self._progressive.moments
            if not self._follow():
                self._slot, self._slots[slot].settings = slot, settings
                self._follow()
        self._show_again()
        if self._slot != slot:
            self._tell_picture(self._slot)

    def _follow(self, answer: Listener | None = None) -> bool:
        """Have the picture follow the settings; false if that cannot be."""
        slot = self._slots[self._slot]
        try:
            if self._progressive.needs_set_up(slot.settings):
                self._tell_state("setting up")
            if self._progressive.follow(slot.settings, slot.kept):
                self._revision += 1
        except (FurclError, ValueError) as error:
            self._refuse(error, answer)
            return False
        return True

    def _refuse(self, error: Exception, answer: Listener | None) -> None:
        if answer:
            answer("error", telling.error(error))
        else:
            self._tell("error", telling.error(error))

    def _apply(self, message: messages.Message) -> None:
        slot = self._slots[self._slot]
        match message:
            case messages.Choose(name):
                self._slot = name
            case messages.Copy():
                other: SlotName = "B" if self._slot == "A" else "A"
                self._slots[other] = Slot(slot.settings, self._progressive.moments)
                self._tell_picture(other)
            case messages.Pause(on):
                self._paused = on
            case _:
                slot.settings = changed_by(slot.settings, message, self._progressive.camera)

    # Telling.

    def _show_again(self) -> None:
        """Tell of what is shown when it is another."""
        self._tell_state()
        if self._paused or not self._progressive.at_first:
            self._show_lobes()

    def _show_lobes(self) -> None:
        residual = self._settings.scene.render.residual
        self._lobes.show(self._progressive.materials, residual)

    def _tell_state(self, doing: str | None = None) -> None:
        text = telling.state(
            self._settings,
            self._progressive.camera,
            slot=self._slot,
            same=self._slots["A"].settings == self._slots["B"].settings,
            revision=self._revision,
            paused=self._paused,
            doing=doing or "",
            drafted=self._progressive.drafted,
            device=self._device.name,
        )
        self._tell("state", text)

    def _tell_picture(self, slot: SlotName) -> None:
        found = self._progressive.shown(self._settings)
        if found:
            moments, facts = found
            kind: Kind = "picture A" if slot == "A" else "picture B"
            facts |= {"slot": slot, "revision": self._revision}
            self._tell(kind, encoded(moments, facts))

    def _tell(self, kind: Kind, message: str | bytes) -> None:
        with self._wake:
            if kind != "error":
                self._last[kind] = message
            listeners = list(self._listeners)
        for listener in listeners:
            with contextlib.suppress(Exception):
                listener(kind, message)


def _groups(asked: Iterable[Asked]) -> Iterator[list[Asked]]:
    """Messages that the picture follows together: those that choose settings stand alone."""
    together: list[Asked] = []
    for one in asked:
        if isinstance(one[0], messages.Choose | messages.Copy):
            if together:
                yield together
            yield [one]
            together = []
        else:
            together.append(one)
    if together:
        yield together
