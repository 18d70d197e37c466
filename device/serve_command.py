"""``borescout serve``: the daemon with its page."""

from __future__ import annotations

import http.client
import logging
import os
import signal
from pathlib import Path
from types import FrameType
from typing import Any

import click

from device.cli import camera_options, chosen_cameras
from device.config import Settings, load_settings
from device.daemon import Device
from device.errors import Invalid
from device.memory import keep_heaps_small
from device.notify import Keeper, Notifier, Watchdog

log = logging.getLogger(__name__)

PAGE_PATIENCE_S = 2.0
PAGE_LIMIT_S = 60.0
"""How long the server's loop may take to come round."""


@click.command()
@camera_options
@click.option("--host", help="Address to listen on; 0.0.0.0 for every network the box is in.")
@click.option("--port", type=int, help="Port to listen on.")
@click.option("--pin", help="Six digits to pair with, in place of the PIN on the label.")
@click.option("--allow-host", "hosts", multiple=True, help="A name, besides its own, by which browsers may call the box.")
def serve(
    virtual: bool,
    tof: bool,
    description: Path | None,
    replay: Path | None,
    cameras: tuple[str, ...],
    data_dir: Path | None,
    config: Path | None,
    host: str | None,
    port: int | None,
    pin: str | None,
    hosts: tuple[str, ...],
) -> None:
    """Run the box: read the cameras, serve the page."""
    chosen = chosen_cameras(virtual, tof, description, replay, cameras)
    if virtual:
        chosen["crawler"] = {"grabber": "virtual", "encoder": "virtual"}
        chosen["structure"] = {"scanner": "virtual"}
        chosen["stereo"] = {"driver": "virtual"}
    settings = load_settings(config, data_dir=data_dir, host=host, port=port, pin=pin, allowed_hosts=hosts or None, **chosen)
    keep_heaps_small()
    device = Device(settings)
    keeper: Keeper | None = None
    try:
        server = _bind(device, settings)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda number, frame: _stop(device, number, frame))
        device.start()
        keeper = _keeper(device, server, settings.host)
        keeper.start()
        click.echo(f"borescout is at http://{_shown_host(settings.host)}:{server.effective_port}")
        # The journal of a system service is no place for a secret; there the label tells it.
        secret = "on the label" if "JOURNAL_STREAM" in os.environ else device.access.pin
        click.echo(f"PIN to pair with: {secret}")
        server.run()
    finally:
        if keeper is not None:
            keeper.close()
        device.close()
        log.info("stopped")


def _keeper(device: Device, server: Any, host: str) -> Keeper:
    """What tells systemd: ready once the page answers and no sensor is awaited, alive while the loops turn, the page's too."""
    notifier = Notifier(os.environ.get("NOTIFY_SOCKET"))
    turned = device.turns.loop("page", PAGE_LIMIT_S)
    return Keeper(
        notifier,
        Watchdog.of(os.environ),
        device.turns,
        ready=lambda: device.settled and _answers(_own_address(host), server.effective_port),
        status=device.status_line,
        poke=lambda: server.trigger.pull_trigger(turned),  # run by the server's own loop when it comes round
    )


def _answers(host: str, port: int) -> bool:
    """Whether the page answers a request, with whatever but a fault of its own."""
    connection = http.client.HTTPConnection(host, port, timeout=PAGE_PATIENCE_S)
    try:
        connection.request("GET", "/robots.txt")
        return connection.getresponse().status < 500
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def _bind(device: Device, settings: Settings) -> Any:
    from web_ui.app import create_app  # the page knows the device; only this command knows them both
    from web_ui.server import make_server

    host, port = settings.host, settings.port
    try:
        return make_server(create_app(device, allowed_hosts=settings.allowed_hosts), host, port)
    except PermissionError:
        raise Invalid(f"Port {port} needs more rights than this user has: choose another --port.") from None
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise Invalid(f"The page cannot be served at {host}:{port}, {reason}: choose another --host or --port.") from None


def _shown_host(host: str) -> str:
    """What to type into a browser on this computer."""
    shown = _own_address(host)
    return f"[{shown}]" if ":" in shown else shown


def _own_address(host: str) -> str:
    """By which this computer reaches itself where it listens at ``host``."""
    return {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(host, host)


def _stop(device: Device, number: int, frame: FrameType | None) -> None:
    """End the event streams first: the server waits for the threads that serve them."""
    device.end_streams()
    raise SystemExit(0)
