"""A web server for the length of a test."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from flask import Flask

from web_ui.events import STREAM_CAP
from web_ui.server import make_server


@contextmanager
def served(app: Flask, stream_cap: int = STREAM_CAP, port: int = 0) -> Iterator[int]:
    """The port of 127.0.0.1 at which `app` is served. Streams must have been ended (by closing the device) before this ends."""
    server = make_server(app, "127.0.0.1", port, stream_cap=stream_cap)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield int(server.effective_port)
    finally:
        server.task_dispatcher.shutdown(timeout=5)
        server.close()
        thread.join(timeout=5)
