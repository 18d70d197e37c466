"""``borescout label``: what is glued to the box, as a page to print: its network, its page and its PIN, with QR codes."""

from __future__ import annotations

import html
from dataclasses import dataclass
from pathlib import Path

import click
import segno
from segno import helpers

from device.access import pin_of
from device.config import load_settings
from device.errors import Invalid

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>Label of {ssid}</title>
<style>
@page {{ size: A6 landscape; margin: 6mm; }}
body {{ font: 11pt/1.3 Arial, "Liberation Sans", sans-serif; color: #000; margin: 0; max-width: 136mm; }}
h1 {{ font-size: 15pt; margin: 0 0 3mm; }}
.codes {{ display: grid; grid-template-columns: 1fr 1fr; gap: 4mm; }}
figure {{ margin: 0; }}
svg {{ width: 44mm; height: 44mm; display: block; }}
b {{ font-family: "Liberation Mono", Consolas, monospace; font-size: 12pt; white-space: nowrap; }}
.pin b {{ font-size: 20pt; letter-spacing: 0.15em; }}
p {{ margin: 2mm 0 0; }}
</style>
<h1>borescout &middot; {ssid}</h1>
<div class="codes">
<figure>{join}<figcaption>1. Join the Wi-Fi<br><b>{ssid}</b><br>Key <b>{key}</b></figcaption></figure>
<figure>{open}<figcaption>2. Open the page<br><b>{address}</b></figcaption></figure>
</div>
<p class="pin">3. PIN <b>{pin}</b></p>
</html>
"""


@dataclass(frozen=True)
class Label:
    """``key`` is that of the Wi-Fi (WPA2), ``address`` that of the page."""

    ssid: str
    key: str
    address: str
    pin: str

    def __post_init__(self) -> None:
        if not 1 <= len(self.ssid.encode()) <= 32:
            raise Invalid("The name of a Wi-Fi has 1 to 32 bytes.")
        if not (8 <= len(self.key) <= 63 and self.key.isascii() and self.key.isprintable()):
            raise Invalid("The key of a Wi-Fi has 8 to 63 letters and digits.")

    def page(self) -> str:
        """The whole page, HTML with its codes inside: nothing is loaded from elsewhere."""
        join = helpers.make_wifi(ssid=self.ssid, password=self.key, security="WPA")
        words = {name: html.escape(getattr(self, name)) for name in ("ssid", "key", "address", "pin")}
        return _PAGE.format(join=_svg(join), open=_svg(segno.make(self.address, error="m", micro=False)), **words)


def _svg(code: segno.QRCode) -> str:
    return code.svg_inline(border=4, omitsize=True, dark="#000", light="#fff")


@click.command()
@click.option("--config", type=click.Path(path_type=Path), help="Settings file (TOML).")
@click.option("--data-dir", type=click.Path(path_type=Path, file_okay=False), help="Where findings are kept, and the PIN.")
@click.option("--ssid", required=True, help="Name of the Wi-Fi.")
@click.option("--key-file", type=click.Path(path_type=Path, dir_okay=False), required=True, help="File with the Wi-Fi's key.")
@click.option("--address", default="http://10.42.0.1/", show_default=True, help="Address of the page.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Where to write the page; else it is printed.")
def label(config: Path | None, data_dir: Path | None, ssid: str, key_file: Path, address: str, out: Path | None) -> int:
    """Print the label of the box: Wi-Fi, page and PIN."""
    settings = load_settings(config, data_dir=data_dir)
    try:
        key = key_file.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise Invalid(f"The key of the Wi-Fi cannot be read from {key_file}: {error}.") from None
    page = Label(ssid, key, address, settings.pin or pin_of(settings.data_dir)).page()
    if out is None:
        click.echo(page)
        return 0
    try:
        out.touch(mode=0o600)
        out.write_text(page, encoding="utf-8")
    except OSError as error:
        raise Invalid(f"The label cannot be written to {out}: {error.strerror}.") from None
    return 0
