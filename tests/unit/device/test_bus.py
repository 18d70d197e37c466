import threading
import time

import pytest

from device.bus import Bus


def test_a_listener_hears_what_is_published_after_it_subscribed() -> None:
    bus = Bus()
    bus.publish("status", {"n": 0})
    subscription = bus.subscribe()
    bus.publish("status", {"n": 1})
    event = subscription.get(1.0)
    assert event is not None
    assert (event.name, event.data) == ("status", {"n": 1})
    assert subscription.get(0.0) is None


def test_newest_wins_per_name_and_the_rest_is_counted() -> None:
    bus = Bus()
    subscription = bus.subscribe()
    for n in range(1000):
        bus.publish("live", {"n": n})
    bus.publish("measurement", {"state": "saved"})
    first, second = subscription.get(0.0), subscription.get(0.0)
    assert first is not None
    assert second is not None
    assert first.data == {"n": 999}
    assert second.data == {"state": "saved"}
    assert subscription.get(0.0) is None
    assert subscription.dropped == 999


def test_a_fast_event_cannot_starve_a_rare_one() -> None:
    bus = Bus()
    subscription = bus.subscribe()
    bus.publish("live", {})
    bus.publish("prompt", {})
    bus.publish("live", {})
    assert [subscription.get(0.0).name, subscription.get(0.0).name] == ["live", "prompt"]


def test_get_wakes_up_when_something_comes() -> None:
    bus = Bus()
    subscription = bus.subscribe()
    threading.Timer(0.05, lambda: bus.publish("status", {"late": True})).start()
    event = subscription.get(5.0)
    assert event is not None
    assert event.data == {"late": True}


def test_closing_the_bus_ends_waiting_listeners_at_once() -> None:
    bus = Bus()
    subscription = bus.subscribe()
    threading.Timer(0.05, bus.close).start()
    begun = time.monotonic()
    assert subscription.get(30.0) is None
    assert time.monotonic() - begun < 10.0
    assert subscription.closed
    assert bus.subscribe().closed


def test_a_closed_listener_hears_nothing_and_may_close_twice() -> None:
    bus = Bus()
    subscription = bus.subscribe()
    subscription.close()
    subscription.close()
    bus.publish("status", {})
    assert subscription.get(0.0) is None


def test_an_event_is_put_into_words_once_for_all_who_listen(monkeypatch: pytest.MonkeyPatch) -> None:
    bus, made = Bus(), []
    monkeypatch.setattr("device.bus.dumps", lambda data: made.append(data) or "{}")
    listeners = [bus.subscribe() for _ in range(8)]
    bus.publish("status", {"a": 1})
    events = [listener.get(1.0) for listener in listeners]
    assert [event.json() for event in events if event] == ["{}"] * 8
    assert made == [{"a": 1}]
