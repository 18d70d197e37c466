"""A call into a camera's library that may hang, with an end to the waiting."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from drivers.base import SensorLost

Result = TypeVar("Result")


class _Outcome(Generic[Result]):
    """Either the value of a call or what it raised."""

    def __init__(self, value: Result | None, error: BaseException | None) -> None:
        self.value = value
        self.error = error


class _Caller:
    """A thread that makes one call after the other. A thread for each call would cost memory that never comes back: OpenCV
    keeps some 900 bytes of every thread that ever used it (its issue 19727), and a camera is asked for pictures for hours."""

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="camera call", daemon=True).start()

    def make(self, call: Callable[[], None]) -> None:
        """Make this call. Returns at once."""
        self._calls.put(call)

    def _run(self) -> None:
        while True:
            self._calls.get()()


_idle: list[_Caller] = []
"""Those that wait for a call. One whose call hangs is not among them until it comes back."""


def _idle_caller() -> _Caller:
    try:
        return _idle.pop()
    except IndexError:
        return _Caller()


def call_within(
    seconds: float, call: Callable[[], Result], sentence: str, undo: Callable[[Result], object] | None = None
) -> Result:
    """``call()`` in another thread, waited for at most ``seconds``; what it raises is raised here.

    Raises SensorLost with ``sentence`` when the time is over. The call cannot be stopped, only left behind: when it comes back
    after all, ``undo`` is called there with its value, so that a pipeline that started too late does not keep the camera to
    itself.
    """
    outcomes: queue.SimpleQueue[_Outcome[Result]] = queue.SimpleQueue()
    lock = threading.Lock()
    abandoned = False
    caller = _idle_caller()

    def run() -> None:
        try:
            outcome: _Outcome[Result] = _Outcome(call(), None)
        except BaseException as error:  # noqa: BLE001 - carried over to the waiting thread and raised there
            outcome = _Outcome(None, error)
        with lock:
            late = abandoned
            if not late:
                _idle.append(caller)  # before anybody knows of the outcome: the next call is this thread's as well
                outcomes.put(outcome)
        if late:
            if undo is not None and outcome.error is None:
                undo(outcome.value)  # type: ignore[arg-type] # None only where the call itself returned None
            _idle.append(caller)

    caller.make(run)
    try:
        outcome = outcomes.get(timeout=seconds)
    except queue.Empty:
        with lock:
            abandoned = True
            empty = outcomes.empty()
        if empty:
            raise SensorLost(sentence) from None
        outcome = outcomes.get()
    if outcome.error is not None:
        raise outcome.error
    return outcome.value  # type: ignore[return-value] # None only where the call itself returned None
