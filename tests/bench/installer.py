"""The installer in a booted container: a clean Debian, systemd-nspawn, the page, a watchdog that bites, a reboot, an uninstall.

    python -m tests.bench.installer [--tree DIR] [--work DIR] [--storm]

Needs root, debootstrap and systemd-nspawn (apt install debootstrap systemd-container), and ``make wheel`` before. The container
has a network of its own with nothing in it; what pip needs is downloaded before, in the versions of requirements/run.txt.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.bench.table import print_table

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "systemd", "systemd-sysv", "libpam-systemd", "dbus", "udev", "python3", "python3-venv", "network-manager", "avahi-daemon",
    "iw", "iproute2", "dnsmasq-base", "wpasupplicant", "ca-certificates", "kmod", "procps", "libglib2.0-0", "libgl1",
)  # fmt: skip
"""What a Raspberry Pi OS Lite has of what borescout touches."""
PATIENCE_S = 240.0


def run(*command: str, check: bool = True, **more: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, check=check, text=True, capture_output=True, **more)  # type: ignore[call-overload, no-any-return]


def clean_tree(tree: Path) -> None:
    """A minimal Debian in ``tree``, made once."""
    if (tree / "etc/debian_version").exists():
        return
    said = run("apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages").stdout.split()
    run("debootstrap", "--variant=minbase", f"--include={','.join(PACKAGES)}", "bookworm", str(tree), *said[:1])


class Container:
    """One container over an overlay of ``tree``; what is changed in it is gone with ``work``."""

    def __init__(self, tree: Path, work: Path, wheels: Path) -> None:
        self.root = work / "root"
        for name in ("root", "upper", "scratch"):
            (work / name).mkdir(parents=True, exist_ok=True)
        layers = f"lowerdir={tree},upperdir={work / 'upper'},workdir={work / 'scratch'}"
        run("mount", "-t", "overlay", "overlay", "-o", layers, str(self.root))
        (self.root / "etc/hostname").write_text("clean\n")
        (self.root / "etc/machine-id").write_text("")
        source = self.root / "root/borescout"
        for folder in ("systemd", "requirements", "dist"):
            shutil.copytree(ROOT / folder, source / folder)
        self._work, self._wheels = work, wheels
        self.start()

    def start(self) -> None:
        """Switch it on."""
        self._log = (self._work / "boot.log").open("a")
        self._nspawn = subprocess.Popen(
            [
                "systemd-nspawn", "--boot", f"--directory={self.root}", "--register=no", "--keep-unit", "--machine=box-test",
                "--private-network", f"--bind-ro={self._wheels}:/wheels", "--console=pipe",
            ],
            stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def reboot(self) -> None:
        """As its user would. systemd-nspawn ends with status 133 where the container wants to be started again."""
        self.sh("systemctl reboot", check=False)
        status = self._nspawn.wait(PATIENCE_S)
        if status != 133:
            raise SystemExit(f"The container did not reboot: status {status}.")
        self._log.close()
        self.start()

    @property
    def leader(self) -> int:
        """The container's own process 1, as seen from here; 0 while there is none."""
        children = run("pgrep", "-P", str(self._nspawn.pid), check=False).stdout.split()
        return int(children[0]) if children else 0

    def sh(self, script: str, check: bool = True) -> str:
        """What a shell in the container says."""
        leader = self.leader
        environment = [
            "env",
            "-i",
            "PATH=/usr/sbin:/usr/bin:/sbin:/bin",
            "PIP_NO_INDEX=1",
            "PIP_FIND_LINKS=/wheels",
            "HOME=/root",
        ]
        done = run("nsenter", f"--target={leader}", "--all", *environment, "sh", "-c", script, check=False)
        if check and done.returncode != 0:
            told = self.sh("journalctl -u borescout -n 40 --no-pager", check=False)
            raise SystemExit(f"In the container {script!r} ended with {done.returncode}:\n{done.stdout}{done.stderr}{told}")
        return done.stdout.strip()

    def wait(self, what: str, condition: Callable[[], bool]) -> float:
        """Seconds until it was so."""
        begun = time.monotonic()
        while not condition():
            if time.monotonic() - begun > PATIENCE_S:
                raise SystemExit(
                    f"{what}: not within {PATIENCE_S:.0f} s\n{self.sh('journalctl -u borescout -n 40', check=False)}"
                )
            time.sleep(0.5)
        return time.monotonic() - begun

    def booted(self) -> bool:
        """Whether systemd has come to rest."""
        state = self.sh("systemctl is-system-running", check=False) if self.leader else ""
        return state in ("running", "degraded")

    def page(self) -> bool:
        """Whether somebody on the container's network gets the page."""
        script = (
            "import urllib.request as u;"
            "a = u.urlopen('http://127.0.0.1/pair', timeout=3);"
            "assert a.status == 200 and b'borescout' in a.read()"
        )
        return run("nsenter", f"--target={self.leader}", "--net", sys.executable, "-c", script, check=False).returncode == 0

    def service(self, name: str) -> str:
        """A property of borescout.service."""
        return self.sh(f"systemctl show borescout.service --property={name} --value", check=False)

    def end(self) -> None:
        """Switch it off and forget what it changed."""
        self._nspawn.send_signal(signal.SIGTERM)
        try:
            self._nspawn.wait(30)
        except subprocess.TimeoutExpired:
            self._nspawn.kill()
            self._nspawn.wait()
        self._log.close()
        run("umount", str(self.root), check=False)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.installer", description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--tree", type=Path, default=Path("/var/tmp/borescout-clean-tree"), help="clean Debian, made if missing"
    )
    parser.add_argument("--work", type=Path, default=Path("/var/tmp/borescout-installer"), help="emptied before and after")
    parser.add_argument("--storm", action="store_true", help="also a service that cannot start, for three minutes")
    options = parser.parse_args()
    missing = [name for name in ("debootstrap", "systemd-nspawn", "nsenter") if shutil.which(name) is None]
    if os.geteuid() != 0 or missing or not list((ROOT / "dist").glob("borescout-*.whl")):
        needs = ", ".join(missing) or "root and a wheel (make wheel)"
        print(f"The installer cannot be tried here: it needs {needs}.", file=sys.stderr)
        raise SystemExit(2)
    shutil.rmtree(options.work, ignore_errors=True)
    clean_tree(options.tree)
    wheels = options.work / "wheels"
    wheels.mkdir(parents=True)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--dest", str(wheels)]
    run(*pip, "--require-hashes", "-r", str(ROOT / "requirements/run.txt"))
    container = Container(options.tree, options.work, wheels)
    try:
        print_table("The installer in a booted container", ("step", "result"), steps(container, options.storm))
    finally:
        container.end()
        shutil.rmtree(options.work, ignore_errors=True)


def steps(box: Container, storm: bool) -> list[tuple[str, str]]:
    """Everything one after the other; raises SystemExit where something is not as it should be."""
    rows: list[tuple[str, str]] = []

    def step(what: str, result: str) -> None:
        print(f"... {what}: {result}", flush=True)
        rows.append((what, result))

    def seconds(taken: float) -> str:
        return f"after {taken:.1f} s"

    box.wait("boot", lambda: box.leader > 0)
    step("clean Debian boots", seconds(box.wait("boot", box.booted)))
    begun = time.monotonic()
    box.sh("cd /root/borescout && systemd/install.sh --camera virtual")
    step("install.sh", seconds(time.monotonic() - begun))
    step("page reachable", seconds(box.wait("page", box.page)))
    step("service", f"{box.service('ActiveState')}, {box.service('Type')}, {box.service('StatusText')}")
    assert box.service("User") == "borescout"
    step("its user", box.sh("ps -o user= -p $(systemctl show borescout -p MainPID --value)"))
    kept = box.sh("cat /var/lib/borescout/pin /etc/borescout/hotspot.key; md5sum /etc/borescout/borescout.toml")
    step("label", box.sh("stat -c '%a %s bytes' /root/borescout-label.html"))
    step("hotspot known to NetworkManager", box.sh("nmcli -t -f NAME connection show | grep -c borescout"))

    box.sh("cd /root/borescout && systemd/install.sh --camera virtual")
    assert box.sh("cat /var/lib/borescout/pin /etc/borescout/hotspot.key; md5sum /etc/borescout/borescout.toml") == kept
    step("install.sh again: PIN, key, settings stay; page", seconds(box.wait("page", box.page)))

    restarts = int(box.service("NRestarts"))
    box.sh("kill -STOP $(systemctl show borescout -p MainPID --value)")
    step(
        "all loops stand still: watchdog bites", seconds(box.wait("watchdog", lambda: int(box.service("NRestarts")) > restarts))
    )
    step("page again", seconds(box.wait("page", box.page)))
    assert "watchdog" in box.sh("journalctl -u borescout --no-pager").lower()

    if storm:
        box.sh("mv /opt/borescout/bin/borescout /opt/borescout/bin/away; systemctl kill -s KILL borescout")
        step(
            "a program that cannot start: given up", seconds(box.wait("storm", lambda: box.service("ActiveState") == "failed"))
        )
        box.sh("mv /opt/borescout/bin/away /opt/borescout/bin/borescout")
        step("begun anew by its timer", seconds(box.wait("again", box.page)))

    box.reboot()
    box.wait("reboot", lambda: box.leader > 0)
    box.wait("boot", box.booted)
    step("reboot: page reachable", seconds(box.wait("page", box.page)))
    assert box.sh("cat /var/lib/borescout/pin /etc/borescout/hotspot.key; md5sum /etc/borescout/borescout.toml") == kept

    box.sh("cd /root/borescout && systemd/install.sh --uninstall")
    left = "/opt/borescout /etc/systemd/system/borescout.service /etc/udev/rules.d/60-borescout.rules"
    assert box.sh(f"ls -d {left} 2>/dev/null || true") == ""
    assert box.sh("ls /var/lib/borescout/pin") != ""
    step("uninstall: program gone, findings stay", box.sh("systemctl is-active borescout || true"))
    box.sh("cd /root/borescout && systemd/install.sh --uninstall --purge")
    assert box.sh("ls -d /var/lib/borescout /etc/borescout 2>/dev/null || true") == ""
    step("uninstall --purge: nothing left", box.sh("cat /etc/hostname"))
    return rows


if __name__ == "__main__":
    main()
