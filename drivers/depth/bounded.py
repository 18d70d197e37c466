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


def call_within(
    seconds: float, call: Callable[[], Result], sentence: str, undo: Callable[[Result], object] | None = None
) -> Result:
    """``call()`` in a thread of its own, waited for at most ``seconds``; what it raises is raised here.

    Raises SensorLost with ``sentence`` when the time is over. The call cannot be stopped, only left behind: when it comes back
    after all, ``undo`` is called there with its value, so that a pipeline that started too late does not keep the camera to
    itself.
    """
    outcomes: queue.SimpleQueue[_Outcome[Result]] = queue.SimpleQueue()
    lock = threading.Lock()
    abandoned = False

    def run() -> None:
        try:
            outcome: _Outcome[Result] = _Outcome(call(), None)
        except BaseException as error:  # noqa: BLE001 - carried over to the waiting thread and raised there
            outcome = _Outcome(None, error)
        with lock:
            outcomes.put(outcome)
            late = abandoned
        if late and undo is not None and outcome.error is None:
            undo(outcome.value)  # type: ignore[arg-type] # None only where the call itself returned None

    threading.Thread(target=run, name="depth-camera-call", daemon=True).start()
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
