"""Work that several runs of a scene share: done for the first run that asks, told to the others."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from mottrack.core.frame import Frame
from mottrack.core.interfaces import (
    FlowSource,
    FrameObserver,
    GroundMap,
    GroundUser,
    ObjectSource,
    Scene,
)
from mottrack.core.motion import FlowField
from mottrack.core.objects import Objects
from mottrack.core.sweep import Sweep
from mottrack.core.timing import charge, collect_timings

R = TypeVar("R")


class Once(Generic[R]):
    """A function of which runs in lockstep ask the same, one after the other.

    It remembers its last call: the value or the error, and the time, which every run that asks is
    charged with, as if it had been alone.
    """

    def __init__(self, function: Callable[..., R]) -> None:
        self._function = function
        self._asked: tuple[Any, ...] | None = None
        self._value: R | None = None
        self._error: Exception | None = None
        self._seconds = 0.0
        self._parts: dict[str, float] = {}

    def __call__(self, *arguments: Any) -> R:
        """Return the value, or raise the error, of the function for these very objects."""
        known = self._asked is not None and all(map(_same, self._asked, arguments))
        if known:
            charge(self._seconds, self._parts)
        else:
            self._ask(arguments)
            charge(0.0, self._parts)
        if self._error is not None:
            raise self._error
        return self._value  # type: ignore[return-value]

    def _ask(self, arguments: tuple[Any, ...]) -> None:
        self._asked, self._value, self._error, self._parts = arguments, None, None, {}
        start = time.perf_counter()
        with collect_timings(self._part):
            try:
                self._value = self._function(*arguments)
            except Exception as error:  # noqa: BLE001 - raised for every run that asks
                self._error = error
        self._seconds = time.perf_counter() - start

    def _part(self, name: str, seconds: float) -> None:
        self._parts[name] = self._parts.get(name, 0.0) + seconds


def _same(known: Any, asked: Any) -> bool:
    """Return whether two arguments are the same object, index or tuple of the same objects."""
    if isinstance(known, tuple) and isinstance(asked, tuple):
        return len(known) == len(asked) and all(map(_same, known, asked))
    return known is asked or (isinstance(known, int) and known == asked)


class SharedFlow:
    """A flow source of several runs: each sweep with its past is measured once."""

    def __init__(self, source: FlowSource) -> None:
        self._source = source
        self.needs_sweeps, self.stateful = source.needs_sweeps, source.stateful
        self.error_model, self.past_sweeps = source.error_model, source.past_sweeps
        self._estimate: Once[FlowField] = Once(source.estimate)
        if isinstance(source, FrameObserver):
            self.observe: Once[None] = Once(source.observe)

    def estimate(self, past: Sequence[Sweep], current: Sweep) -> FlowField:
        """Return the source's field for these sweeps.

        Raises:
            MottrackError: whatever the source raises, for every run.
        """
        return self._estimate(tuple(past), current)

    def reset(self) -> None:
        """Reset the source."""
        self._source.reset()


class SharedObjects:
    """An object source of several runs: each frame's objects are found once."""

    def __init__(self, source: ObjectSource) -> None:
        self._source = source
        self.needs_sweeps, self.needs_detections = source.needs_sweeps, source.needs_detections
        self._objects: Once[Objects] = Once(source.objects)

    def objects(self, frame: Frame, sweep: Sweep | None) -> Objects:
        """Return the source's objects of this frame.

        Raises:
            MottrackError: whatever the source raises, for every run.
        """
        return self._objects(frame, sweep)

    def use_ground(self, ground: GroundMap) -> None:
        """Pass the map on to a source that uses it."""
        if isinstance(self._source, GroundUser):
            self._source.use_ground(ground)

    def reset(self) -> None:
        """Reset the source."""
        self._source.reset()


class SharedFrames:
    """The frames and sweeps of a scene, each read once."""

    def __init__(self, scene: Scene) -> None:
        self.frame: Once[Frame] = Once(scene.frame)
        self.sweep: Once[Sweep] = Once(scene.sweep)
