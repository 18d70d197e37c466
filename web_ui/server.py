"""The web server, set for long-lived event streams on a small box."""

import logging
import socket
from typing import Any

from flask import Flask
from waitress.adjustments import Adjustments

from web_ui import connections, guards
from web_ui.events import STREAM_CAP

_PICTURE_AND_API_THREADS = 6
# Seconds after which a phone that vanished without a word no longer holds a stream; Linux only.
_SILENT_PEER_S = 15


def _listen(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, address = min(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))  # IPv4 before IPv6
    listener = socket.socket(family, kind, protocol)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Connections inherit these: unanswered data ends a connection, and idle ones are asked now and then.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        timeout = getattr(socket, "TCP_USER_TIMEOUT", None)
        if timeout is not None:
            listener.setsockopt(socket.IPPROTO_TCP, timeout, _SILENT_PEER_S * 1000)
        listener.bind(address)
    except OSError:
        listener.close()
        raise
    return listener


def make_server(app: Flask, host: str, port: int, *, stream_cap: int = STREAM_CAP) -> Any:
    """A waitress server for `app`, bound to (host, port) once this returns; call `.run()`, and `.close()` to end it.

    `.effective_port` is the port in use, where 0 was asked for. Raises OSError where the address cannot be bound. Each stream
    holds a thread, so there are as many as streams and some more.
    """
    # It tells of every phone that leaves in the middle of a picture, which they do all day.
    logging.getLogger("waitress").setLevel(logging.WARNING)
    logging.getLogger("waitress.queue").setLevel(logging.ERROR)  # a line for each request that waits: many fill a disk
    listener = _listen(host, port)
    adjustments = Adjustments(
        sockets=[listener],
        threads=stream_cap + _PICTURE_AND_API_THREADS,
        ident="borescout",
        # Needed for `waitress.client_disconnected`: without it the server does not look at the socket while a request runs.
        channel_request_lookahead=1,
        cleanup_interval=1,
        connection_limit=connections.MOST_CONNECTIONS + 20,
        backlog=256,
        max_request_header_size=16 * 1024,
        max_request_body_size=2 * guards.MAX_BODY_BYTES,  # what is larger than its half is answered in words
        # A stalled stream may hold this much; the default of 16 MB for each of them is more than the box has to spare.
        outbuf_high_watermark=256 * 1024,
        clear_untrusted_proxy_headers=True,
        log_socket_errors=False,
        asyncore_use_poll=True,
    )
    place = (listener.family, listener.type, listener.proto, listener.getsockname())
    return connections.Server(app, {}, True, listener, adj=adjustments, bind_socket=False, sockinfo=place)
