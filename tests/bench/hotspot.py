"""The hotspot on radios of the kernel (mac80211_hwsim) in an emulated machine: joined, silenced, restored.

    python -m tests.bench.hotspot [--kernel /boot/vmlinuz-...]

qemu runs Debian's kernel over this machine's own root (9p, read-only, changes in memory). The box is the connection file of the
installer under NetworkManager and ``borescout serve``; the phone is the other radio in a network namespace of its own, with
wpa_supplicant and a DHCP client. Needs qemu-system-x86, a kernel with its modules, busybox-static, network-manager,
wpasupplicant, dnsmasq-base, iw, iproute2, isc-dhcp-client and dbus; some minutes, since everything is emulated.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.bench.table import print_table

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 2400
PROGRAMS = (
    "qemu-system-x86_64",
    "busybox",
    "NetworkManager",
    "wpa_supplicant",
    "dnsmasq",
    "iw",
    "ip",
    "dhclient",
    "dbus-daemon",
    "cpio",
)
EARLY = ("virtio_pci", "9p", "9pnet_virtio", "overlay")
"""Modules without which the root cannot be seen."""

INIT = """#!/bin/busybox sh
/bin/busybox mkdir -p /proc /sys /dev /lower /upper /root
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
/bin/busybox mount -t devtmpfs dev /dev
while read -r module; do /bin/busybox insmod "/modules/$module" 2>/dev/null; done < /modules/order
/bin/busybox mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=512000,cache=loose host /lower || echo "RESULT no root"
/bin/busybox mount -t tmpfs tmpfs /upper
/bin/busybox mkdir /upper/changes /upper/work
/bin/busybox mount -t overlay -o lowerdir=/lower,upperdir=/upper/changes,workdir=/upper/work overlay /root
/bin/busybox mount --move /dev /root/dev
/bin/busybox mount --move /proc /root/proc
/bin/busybox mount --move /sys /root/sys
export REPOSITORY={repository} PYTHON={python}
exec /bin/busybox switch_root /root /bin/sh {repository}/tests/bench/hotspot_machine.sh
"""


def modules(kernel: str, names: tuple[str, ...]) -> list[Path]:
    """What is to be loaded for ``names``, in order."""
    found: list[Path] = []
    for name in names:
        said = subprocess.run(["modprobe", "-S", kernel, "--show-depends", name], capture_output=True, text=True, check=True)
        for line in said.stdout.splitlines():
            path = Path(line.split()[1])
            if line.startswith("insmod") and path not in found:
                found.append(path)
    return found


def initrd(folder: Path, kernel: str) -> Path:
    """A first root with busybox, the modules and INIT."""
    root = folder / "initrd"
    (root / "bin").mkdir(parents=True)
    (root / "modules").mkdir()
    shutil.copy("/bin/busybox", root / "bin/busybox")
    order = modules(kernel, EARLY)
    for path in order:
        shutil.copy(path, root / "modules")
    (root / "modules/order").write_text("".join(f"{path.name}\n" for path in order))
    init = root / "init"
    init.write_text(INIT.format(repository=ROOT, python=sys.executable))
    init.chmod(0o755)
    image = folder / "initrd.img"
    with image.open("wb") as out:
        subprocess.run("find . | cpio --quiet -o -H newc", shell=True, cwd=root, stdout=out, check=True)
    return image


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.hotspot", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kernel", type=Path, help="with modules of the same version installed")
    parser.add_argument("--log", type=Path, help="keep the console here")
    options = parser.parse_args()
    with_radio = [path for path in Path("/lib/modules").glob("*") if list(path.rglob("mac80211_hwsim.ko*"))]
    kernel = options.kernel or next((path for one in with_radio if (path := Path(f"/boot/vmlinuz-{one.name}")).exists()), None)
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing or kernel is None:
        needs = ", ".join([*missing, *([] if kernel else ["a kernel with mac80211_hwsim (linux-image-amd64)"])])
        print(f"The hotspot cannot be tried here: it needs {needs}.", file=sys.stderr)
        raise SystemExit(2)
    with tempfile.TemporaryDirectory(prefix="borescout-hotspot-", dir="/var/tmp") as name:
        folder = Path(name)
        image = initrd(folder, kernel.name.removeprefix("vmlinuz-"))
        command = [
            "qemu-system-x86_64", "-cpu", "max", "-smp", "2", "-m", "3G", "-nographic", "-no-reboot", "-nic", "none",
            "-kernel", str(kernel), "-initrd", str(image), "-append", "console=ttyS0 quiet panic=-1",
            "-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap",
        ]  # fmt: skip
        log = options.log or folder / "console.txt"
        with log.open("wb") as console:
            try:
                subprocess.run(command, stdin=subprocess.DEVNULL, stdout=console, stderr=subprocess.STDOUT, timeout=LIMIT_S)
            except subprocess.TimeoutExpired:
                print(f"It took longer than {LIMIT_S} s.", file=sys.stderr)
        text = log.read_text(errors="replace")
    said = re.findall(r"^RESULT ([^\r\n]*)", text, re.MULTILINE)
    rows = [tuple(line.replace("|", "\0", 1).split("\0")) for line in said if "|" in line]
    print_table("The hotspot on radios of the kernel", ("step", "result"), rows)
    if "end" not in said or any("never" in line for line in said):
        print(text[-3000:], file=sys.stderr)
        raise SystemExit(1)


if __name__ == "__main__":
    main()
