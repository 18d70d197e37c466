"""Live events: the wire, the cap, one stream per tab, and the end of a stream when its client is gone."""

import http.client
import time
from collections.abc import Iterator
from typing import ClassVar

import pytest

from device.bus import Bus
from tests.browser.fake_device import FakeDevice
from tests.browser.serving import served
from tests.pairing import Pass, pair
from web_ui import events
from web_ui.app import create_app


@pytest.fixture
def port(device: FakeDevice) -> Iterator[int]:
    app = create_app(device, stream_cap=3)  # type: ignore[arg-type]  # a fake with the facade's methods
    with served(app, stream_cap=3) as port:
        Listener.paired = pair(port)
        yield port
        device.close()


class Listener:
    paired: ClassVar[Pass]

    def __init__(self, port: int, tab: str = "") -> None:
        self.connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        self.connection.request("GET", f"/api/v1/events?tab={tab}", headers=self.paired.headers)
        self.response = self.connection.getresponse()

    def names(self, seconds: float) -> list[str]:
        """The names of the events of the next `seconds`."""
        names = []
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            line = self.response.readline().decode()
            if not line:
                break
            if line.startswith("event: "):
                names.append(line.removeprefix("event: ").strip())
        return names

    def ended(self) -> bool:
        """True when the server ends the stream (within the connection's time-out)."""
        while self.response.readline():
            pass
        return True

    def close(self) -> None:
        self.response.close()
        self.connection.close()


def admitted(port: int, tab: str = "", within_s: float = 5.0) -> Listener | None:
    end = time.monotonic() + within_s
    while True:
        listener = Listener(port, tab)
        if listener.response.status == 200:
            return listener
        listener.close()
        if time.monotonic() > end:
            return None
        time.sleep(0.2)


def test_a_stream_begins_with_the_state_of_things_and_goes_on_at_two_hertz_or_better(port: int) -> None:
    listener = Listener(port)
    assert listener.response.getheader("Content-Type", "").startswith("text/event-stream")
    assert listener.response.getheader("Cache-Control") == "no-store"
    names = listener.names(2.5)
    assert names[:2] == ["status", "live"]
    assert names.count("live") >= 6
    assert names.count("status") >= 3
    listener.close()


def test_beyond_the_cap_a_clear_refusal_and_a_place_again_when_a_client_goes(port: int) -> None:
    listeners = [Listener(port) for _ in range(3)]
    assert [listener.response.status for listener in listeners] == [200] * 3
    refused = Listener(port)
    assert refused.response.status == 503
    assert int(refused.response.getheader("Retry-After", "0")) > 0
    assert b"already watching" in refused.response.read()
    listeners[0].close()
    assert admitted(port) is not None, "the place of a client that left must be free within seconds"


def test_a_tab_that_comes_back_takes_the_place_of_its_old_stream(port: int) -> None:
    old = Listener(port, "tab-1")
    old.names(0.1)
    others = [Listener(port), Listener(port)]
    new = Listener(port, "tab-1")
    assert new.response.status == 200
    assert old.ended()
    assert new.names(1.0), "the new stream must live on after the old one is gone"
    assert Listener(port, "tab-2").response.status == 503
    assert len(others) == 2


def test_asking_for_the_head_of_a_stream_takes_no_place(port: int) -> None:
    for _ in range(6):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        connection.request("HEAD", "/api/v1/events", headers=Listener.paired.headers)
        assert connection.getresponse().status == 200
        connection.close()
    assert Listener(port).response.status == 200


def test_a_closed_stream_leaves_no_subscription(device: FakeDevice) -> None:
    bus = Bus()
    device.subscribe = bus.subscribe  # type: ignore[method-assign]  # to look behind it
    stream = events.Stream(device, lambda: False)  # type: ignore[arg-type]  # a fake with the facade's methods
    next(iter(stream))
    stream.close()
    assert bus._subscriptions == []


def test_a_bad_tab_name_is_refused(port: int) -> None:
    for tab in ("a" * 41, "a%0Ab", "../x", "%C3%A9"):
        assert Listener(port, tab).response.status == 422


def test_silence_is_broken_by_a_heartbeat(device: FakeDevice, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "HEARTBEAT_S", 0.0)
    monkeypatch.setattr(device, "subscribe", Bus().subscribe)  # a bus on which nothing is ever published
    stream = events.Stream(device, lambda: False)  # type: ignore[arg-type]  # a fake with the facade's methods
    chunks = iter(stream)
    assert [next(chunks) for _ in range(8)][6:] == [b": still here\n\n"] * 2
    stream.close()
    assert list(chunks) == []


def test_a_device_that_closes_ends_its_streams(port: int, device: FakeDevice) -> None:
    listener = Listener(port)
    listener.names(0.1)
    device.close()
    assert listener.ended()


def test_an_event_is_one_line_of_json() -> None:
    assert events.frame("live", {"a": "x\ny", "b": float("nan")}) == b'event: live\ndata: {"a":"x\\ny","b":null}\n\n'


def test_a_stream_ends_with_its_session(port: int, device: FakeDevice) -> None:
    listener, other = Listener(port), pair(port)
    listener.names(0.1)
    for row in device.access.devices():
        if row["id"] != device.access.session(other.cookie).id:  # type: ignore[union-attr]  # it has just paired
            device.access.end(row["id"])
    assert listener.ended()
    refused = Listener(port)
    assert refused.response.status == 401


def test_an_event_tells_when_it_was_told(device: FakeDevice) -> None:
    bus = Bus()
    device.subscribe = bus.subscribe  # type: ignore[method-assign]  # to publish by hand
    stream = events.Stream(device, lambda: False)  # type: ignore[arg-type]  # a fake with the facade's methods
    chunks = iter(stream)
    for _ in range(6):
        next(chunks)
    before = time.monotonic_ns()
    bus.publish("live", {"a": 1})
    head, rest = next(chunks).split(b"\n", 1)
    assert before <= int(head.removeprefix(b"id: ")) <= time.monotonic_ns()
    assert rest == b'event: live\ndata: {"a":1}\n\n'
    stream.close()
