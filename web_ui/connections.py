"""What a connection may ask of the server: a box in a street is in reach of everybody who stands there.

waitress reads requests in one thread and runs them in a few others; by itself it waits for ever for who sends a byte a second,
lets a few hundred idle connections keep everybody else out, and lets who never reads its answers hold its threads. Here each
connection has to get on with it, each address has its share, and who is turned away is the one that has been idle longest.
"""

import time
from dataclasses import dataclass
from typing import Any

from waitress.channel import HTTPChannel
from waitress.server import TcpWSGIServer

MOST_CONNECTIONS = 200
MOST_OF_AN_ADDRESS = 32
"""A browser opens six."""
REQUEST_S = 10.0
"""From the first byte of a request to its last."""
IDLE_S = 30.0
"""Between two requests."""
SLOWEST_READER_BYTES_S = 1024
STALL_S = 15.0
"""Who takes less than that of an answer, over so long, is cut off."""
MOST_WAITING_REQUESTS = 8
"""Of one connection, sent without waiting for the answers; no browser does that."""
REQUESTS_S = 150.0
"""Of one address, over time: the pages of ten phones. Who asks more is not listened to for a moment."""
BURST = 300.0


@dataclass
class _Share:
    """What an address may still ask for just now."""

    left: float
    at: float

    def take(self, now: float, count: int) -> None:
        self.left = max(-BURST, min(BURST, self.left + (now - self.at) * REQUESTS_S) - count)  # nobody waits longer than 2 s
        self.at = now

    def spent(self, now: float) -> bool:
        return self.left + (now - self.at) * REQUESTS_S < 0


class Connection(HTTPChannel):
    """One client's connection, with what it has done and when (s, monotonic)."""

    def __init__(self, server: "Server", sock: Any, addr: Any, adj: Any, map: Any = None) -> None:
        now = time.monotonic()
        self.address = str(addr[0])
        self.useful_s = now  # when it was opened, or last sent a whole request
        self._partial: Any = None
        self._partial_s = now
        self._sent = 0
        self._mark = (now, 0)
        self._busy_s = now
        super().__init__(server, sock, addr, adj, map=map)

    def readable(self) -> bool:
        return super().readable() and not self.server.share(self.address).spent(time.monotonic())

    def received(self, data: bytes) -> bool:
        before = len(self.requests)
        more: bool = super().received(data)
        now = time.monotonic()
        whole = len(self.requests) - before  # the threads only take away: never too many
        if whole > 0:
            self.useful_s = now
            self.server.share(self.address).take(now, whole)
        if self.request is not self._partial:
            self._partial, self._partial_s = self.request, now
        if len(self.requests) > MOST_WAITING_REQUESTS:
            self.handle_close()
        return more

    def send(self, data: bytes, do_close: bool = True) -> int:
        sent: int = super().send(data, do_close=do_close)
        self._sent += sent
        return sent

    @property
    def busy(self) -> bool:
        """A request of it is in work, or its answer on the way."""
        return bool(self.requests or self.total_outbufs_len)

    def tarries(self, now: float) -> bool:
        """Whether it has to go: a request that does not end, nothing for too long, or an answer that is not taken."""
        if self.request is not None and now - self._partial_s > REQUEST_S:
            return True
        if self.busy or self.request is not None:
            self._busy_s = now
        if not self.total_outbufs_len:
            self._mark = (now, self._sent)
        elif now - self._mark[0] > STALL_S:
            taken = self._sent - self._mark[1]
            self._mark = (now, self._sent)
            return taken < SLOWEST_READER_BYTES_S * STALL_S
        return now - self._busy_s > IDLE_S


class Server(TcpWSGIServer):
    """waitress' server with limits in front."""

    channel_class = Connection

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self._shares: dict[str, _Share] = {}
        super().__init__(*arguments, **named)

    def share(self, address: str) -> _Share:
        """What that address may still ask for."""
        share = self._shares.get(address)
        if share is None:
            share = self._shares[address] = _Share(BURST, time.monotonic())
        return share

    def handle_accept(self) -> None:
        known = set(self.active_channels)
        super().handle_accept()
        for number in set(self.active_channels) - known:
            newest = self.active_channels[number]
            self.share(newest.address).take(time.monotonic(), 1)
            self._make_room(newest)

    def maintenance(self, now: float) -> None:
        """Called every second: close whoever has to go. Not by `will_close`: that waits until the peer can be written to."""
        moment = time.monotonic()
        channels = list(self.active_channels.values())
        for channel in channels:
            if channel.tarries(moment):
                channel.handle_close()
        here = {channel.address for channel in channels}
        for address, share in list(self._shares.items()):
            if address not in here and not share.spent(moment):
                del self._shares[address]

    def _make_room(self, newest: Connection) -> None:
        same = [channel for channel in self.active_channels.values() if channel.address == newest.address]
        crowd = same if len(same) > MOST_OF_AN_ADDRESS else list(self.active_channels.values())
        if len(same) <= MOST_OF_AN_ADDRESS and len(crowd) <= MOST_CONNECTIONS:
            return
        idle = [channel for channel in crowd if not channel.busy]
        min(idle, key=lambda channel: channel.useful_s, default=newest).handle_close()
