#!/bin/sh
# Puts borescout on a Raspberry Pi (Raspberry Pi OS or Debian 12 or newer) so that it boots by itself; see --help.
# Run it again after a new wheel or to change an option: what is there is brought up to date, settings and findings stay.
set -eu

usage() {
  cat <<'X'
Usage: sudo systemd/install.sh [options]

  --wheel FILE        the wheel to install (default: the newest in dist/)
  --extras LIST       what the box is made of: realsense,oak,osd,lamp (default: none)
  --camera KIND       realsense, oak or virtual (default: realsense); only for a new settings file
  --wifi INTERFACE    the radio of the hotspot (default: wlan0)
  --no-hotspot        leave the network as it is
  --country CODE      where the radio is used, two letters (DE, GB, ...); the radio stays off without one
  --read-only-root    findings on the partition labelled "borescout", everything else read-only from the next boot on
  --uninstall         take away all that was installed; settings and findings stay
  --purge             with --uninstall: settings and findings too
X
}

say() { echo "install: $*"; }
fail() { echo "install: $*" >&2; exit 2; }

here=$(cd "$(dirname "$0")" && pwd)
wheel= extras= camera=realsense wifi=wlan0 hotspot=yes country= read_only=no uninstall=no purge=no
while [ $# -gt 0 ]; do
  case $1 in
    --wheel|--extras|--camera|--wifi|--country)
      [ $# -ge 2 ] || fail "$1 needs a value."
      case $1 in
        --wheel) wheel=$2 ;; --extras) extras=$2 ;; --camera) camera=$2 ;; --wifi) wifi=$2 ;; --country) country=$2 ;;
      esac
      shift ;;
    --no-hotspot) hotspot=no ;;
    --read-only-root) read_only=yes ;;
    --uninstall) uninstall=yes ;;
    --purge) purge=yes ;;
    -h|--help) usage; exit 0 ;;
    *) usage >&2; fail "There is no option $1." ;;
  esac
  shift
done
[ "$(id -u)" = 0 ] || fail "Run it as root: sudo $0."
case $camera in realsense|oak|virtual) ;; *) fail "There is no camera called $camera." ;; esac
case $wifi in *[!a-zA-Z0-9._-]*|'') fail "$wifi is no name of a network interface." ;; esac
case $country in ''|[A-Z][A-Z]) ;; *) fail "A country is two capital letters, not $country." ;; esac
[ $purge = no ] || [ $uninstall = yes ] || fail "--purge goes with --uninstall."

venv=/opt/borescout
settings=/etc/borescout
findings=/var/lib/borescout
units="borescout.service borescout-again.service borescout-again.timer"
nm=/etc/NetworkManager
connection=$nm/system-connections/borescout.nmconnection

# Where each file goes: source below systemd/, target, mode. Those of the hotspot are made separately: they hold its key.
files() {
  for unit in $units; do echo "$unit /etc/systemd/system/$unit 644"; done
  echo "etc/journald.conf /etc/systemd/journald.conf.d/borescout.conf 644"
  echo "etc/watchdog.conf /etc/systemd/system.conf.d/borescout.conf 644"
  echo "etc/60-borescout.rules /etc/udev/rules.d/60-borescout.rules 644"
  echo "etc/avahi.service /etc/avahi/services/borescout.service 644"
  echo "etc/polkit.rules /etc/polkit-1/rules.d/60-borescout.rules 644"
  if [ $hotspot = yes ]; then echo "etc/dnsmasq.conf $nm/dnsmasq-shared.d/borescout.conf 644"; fi
}

# systemd may not be running: in an image that is being built everything takes effect at its first boot.
running() { [ -d /run/systemd/system ]; }
if_running() { if running; then "$@" || say "this did not work, and takes effect at the next boot: $*"; fi; }
reload_all() {
  if_running systemctl daemon-reload
  if_running systemctl try-restart systemd-journald.service
  if running && command -v udevadm >/dev/null; then udevadm control --reload || true; udevadm trigger --subsystem-match=usb || true; fi
  if running && command -v nmcli >/dev/null && systemctl is-active --quiet NetworkManager; then nmcli connection reload || true; fi
}

if [ $uninstall = yes ]; then
  if_running systemctl disable --now borescout-again.timer borescout.service 2>/dev/null
  running || systemctl disable borescout.service 2>/dev/null || true
  if running && command -v nmcli >/dev/null; then nmcli connection down borescout >/dev/null 2>&1 || true; fi
  hotspot=yes
  files | while read -r _ target _; do rm -f "$target"; done
  rm -f "$connection" /root/borescout-label.html
  if [ -e /etc/systemd/system/var-lib-borescout.mount ]; then
    say "the partition of the findings stays mounted until the next boot"
    systemctl disable var-lib-borescout.mount 2>/dev/null || true
    rm -f /etc/systemd/system/var-lib-borescout.mount
  fi
  if [ -e $settings/hostname-before ]; then
    before=$(cat $settings/hostname-before)
    if running && command -v hostnamectl >/dev/null; then hostnamectl set-hostname "$before"; else echo "$before" >/etc/hostname; fi
    rm -f $settings/hostname-before
  fi
  rm -rf "$venv"
  if [ $purge = yes ]; then
    rm -rf "$settings"
    if grep -q " $findings " /proc/mounts; then find $findings -mindepth 1 -delete; else rm -rf "$findings"; fi
    if getent passwd borescout >/dev/null; then userdel borescout; fi
  fi
  reload_all
  if [ $purge = yes ]; then say "borescout is gone"; else say "borescout is gone; settings in $settings and findings in $findings stay"; fi
  exit 0
fi

command -v python3 >/dev/null && python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
  || fail "Python 3.11 or newer with venv is missing: apt install python3-venv."
[ -d /etc/systemd ] || fail "This computer has no systemd."
if [ -z "$wheel" ]; then wheel=$(ls -t "$here"/../dist/borescout-*.whl 2>/dev/null | head -n 1); fi
[ -n "$wheel" ] && [ -f "$wheel" ] || fail "There is no wheel: build one with make wheel, or name one with --wheel."
if [ $hotspot = yes ]; then
  [ -d $nm ] || fail "NetworkManager is missing: apt install network-manager, or leave the network alone with --no-hotspot."
fi
if [ $read_only = yes ]; then
  command -v raspi-config >/dev/null || fail "--read-only-root needs raspi-config, which comes with Raspberry Pi OS."
  [ -e /dev/disk/by-label/borescout ] || fail "There is no partition labelled borescout: make one, mkfs.ext4 -L borescout /dev/..."
fi

# The user, in the groups that may use what the box is plugged into.
getent passwd borescout >/dev/null || useradd --system --user-group --home-dir $findings --no-create-home --shell /usr/sbin/nologin borescout
for group in video plugdev dialout gpio render; do
  if getent group $group >/dev/null; then usermod --append --groups $group borescout; fi
done

# The program. What it needs comes in the versions that were tested, where the list is beside this script.
[ -x $venv/bin/python ] || python3 -m venv $venv
pip() { $venv/bin/python -m pip --quiet --disable-pip-version-check "$@"; }
if [ -f "$here/../requirements/run.txt" ]; then pip install --require-hashes -r "$here/../requirements/run.txt"; fi
pip install --upgrade "$wheel${extras:+[$extras]}"
pip install --force-reinstall --no-deps "$wheel"
chmod -R go-w $venv

# Settings and the key of the hotspot are made once.
mkdir -p $settings
chmod 755 $settings
id=$(cut -c 1-4 /etc/machine-id 2>/dev/null || true)
[ -n "$id" ] || id=$($venv/bin/python -c 'import secrets; print(secrets.token_hex(2))')
[ -s $settings/ssid ] || echo "borescout-$id" >$settings/ssid
if [ ! -s $settings/hotspot.key ]; then
  (umask 077; $venv/bin/python -c 'import secrets; print("".join(secrets.choice("abcdefghjkmnpqrstuvwxyz23456789") for _ in range(12)))' \
    >$settings/hotspot.key)
fi
if [ ! -e $settings/borescout.toml ]; then
  crawler=
  [ $camera != virtual ] || crawler=$(printf '\n[crawler]\ngrabber = "virtual"\nencoder = "virtual"\n')
  [ $hotspot = yes ] && name=borescout || name=
  sed -e "s/@CAMERA@/$camera/" -e "s/@WIFI@/$wifi/" -e "s/@HOTSPOT@/$name/" -e '/@CRAWLER@/d' "$here/etc/borescout.toml" >$settings/borescout.toml.new
  [ -z "$crawler" ] || echo "$crawler" >>$settings/borescout.toml.new
  mv $settings/borescout.toml.new $settings/borescout.toml
fi
chmod 644 $settings/borescout.toml

files | while read -r source target mode; do install -D -m "$mode" "$here/$source" "$target"; done
if [ -d /etc/polkit-1/rules.d ] && getent group polkitd >/dev/null; then chgrp polkitd /etc/polkit-1/rules.d 2>/dev/null || true; fi

if [ $hotspot = yes ]; then
  (umask 077; mkdir -p "$(dirname $connection)"
   sed -e "s/@WIFI@/$wifi/" -e "s/@SSID@/$(cat $settings/ssid)/" -e "s/@KEY@/$(cat $settings/hotspot.key)/" \
     "$here/etc/hotspot.nmconnection" >$connection.new && mv $connection.new $connection)
  if [ -n "$country" ]; then
    if command -v raspi-config >/dev/null; then raspi-config nonint do_wifi_country "$country"
    elif command -v iw >/dev/null; then iw reg set "$country" || true; fi
  fi
  if command -v rfkill >/dev/null; then rfkill unblock wifi || true; fi
fi

# By name on the network: borescout.local.
if [ "$(cat /etc/hostname 2>/dev/null)" != borescout ]; then
  [ -e $settings/hostname-before ] || cp /etc/hostname $settings/hostname-before 2>/dev/null || true
  if running && command -v hostnamectl >/dev/null; then hostnamectl set-hostname borescout || true; fi
  echo borescout >/etc/hostname
  grep -q '^127\.0\.1\.1[[:space:]].*borescout' /etc/hosts 2>/dev/null || echo "127.0.1.1 borescout" >>/etc/hosts
fi

if [ $read_only = yes ]; then
  install -m 644 "$here/var-lib-borescout.mount" /etc/systemd/system/
  systemctl enable var-lib-borescout.mount
  raspi-config nonint enable_overlayfs
  say "from the next boot on everything but $findings is read-only; undo it with raspi-config nonint disable_overlayfs"
fi

install -d -o borescout -g borescout -m 700 $findings
(umask 077
 PYTHONDONTWRITEBYTECODE=1 $venv/bin/borescout label --config $settings/borescout.toml --data-dir $findings \
   --ssid "$(cat $settings/ssid)" --key-file $settings/hotspot.key --out /root/borescout-label.html)
chown -R borescout:borescout $findings

reload_all
systemctl enable borescout.service >/dev/null 2>&1 || fail "systemd could not enable borescout.service."
if running; then
  systemctl restart borescout.service || fail "borescout does not start: journalctl -u borescout tells why."
  if [ $hotspot = yes ] && command -v nmcli >/dev/null && [ -d "/sys/class/net/$wifi" ]; then
    nmcli connection up borescout >/dev/null || say "the hotspot did not come up; it is tried again"
  fi
fi
say "borescout is installed; print /root/borescout-label.html and glue it to the box"
