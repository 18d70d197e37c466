#!/bin/sh
# Process 1 of the machine that tests/bench/hotspot.py emulates; $REPOSITORY and $PYTHON are set by it. Lines that begin with
# RESULT are what it reads: step|result.
exec </dev/null >/dev/console 2>&1
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root
result() { echo "RESULT $*"; }
now() { cut -d. -f1 /proc/uptime; }
off() { result end; sync; echo o >/proc/sysrq-trigger; sleep 60; }
wait_for() { n=0; until eval "$2" >/dev/null 2>&1; do n=$((n+1)); [ $n -ge $3 ] && { result "$1|never"; return 1; }; sleep 1; done; }
sends() { iw dev wlan0 info | tr -d "\n" | grep -q "ssid.*type AP.*channel"; }
mount -t tmpfs tmpfs /run; mount -t tmpfs tmpfs /tmp; mkdir -p /run/dbus /run/lock /run/netns
mount -t tmpfs tmpfs /etc/NetworkManager/system-connections; mount -t tmpfs tmpfs /var/lib/NetworkManager
ip link set lo up
modprobe mac80211_hwsim radios=2 || result "radios|none"
# As the installer writes it.
sed -e 's/@WIFI@/wlan0/' -e 's/@SSID@/borescout-test/' -e 's/@KEY@/k7mp2xqz9fhd/' "$REPOSITORY"/systemd/etc/hotspot.nmconnection \
  >/etc/NetworkManager/system-connections/borescout.nmconnection
chmod 600 /etc/NetworkManager/system-connections/*
mkdir -p /etc/NetworkManager/dnsmasq-shared.d
cp "$REPOSITORY"/systemd/etc/dnsmasq.conf /etc/NetworkManager/dnsmasq-shared.d/
printf '[main]\nauth-polkit=false\nplugins=keyfile\n[ifupdown]\nmanaged=false\n' >/etc/NetworkManager/NetworkManager.conf
printf '[device]\nwifi.scan-rand-mac-address=no\n[keyfile]\nunmanaged-devices=interface-name:wlan1\n' \
  >/etc/NetworkManager/conf.d/test.conf
dbus-daemon --system --fork
wpa_supplicant -u -s -B
# The phone: a radio in a namespace of its own.
ip netns add phone
ip link set wlan1 down
phy=$(cat /sys/class/net/wlan1/phy80211/name)
iw phy "$phy" set netns name phone
ip netns exec phone ip link set lo up
mount -o remount,ro /sys # so that NetworkManager does not wait for udev, which does not run here
NetworkManager --log-level=INFO >/tmp/nm.log 2>&1
cat >/tmp/box.toml <<X
host = "0.0.0.0"
port = 80
pin = "123456"
cameras = ["realsense"] # none is plugged in: drawing virtual pictures would take all of an emulated processor
allowed_hosts = ["borescout.local", "borescout.lan"]
[machine]
wifi = "wlan0"
hotspot = "borescout"
X
cd "$REPOSITORY"
"$PYTHON" -m device.cli serve --config /tmp/box.toml --data-dir /tmp/data >/tmp/box.log 2>&1 &
box=$!
begun=$(now)
(while sleep 60; do echo "box: $(tail -n 1 /tmp/box.log)"; done) &
wait_for "hotspot up" sends 240 || { nmcli device; nmcli connection; cat /tmp/nm.log; off; }
result "hotspot|up|$(iw dev wlan0 info | tr -s '\n\t' ' ')"
cat >/tmp/phone.conf <<X
network={
  ssid="borescout-test"
  psk="k7mp2xqz9fhd"
  proto=RSN
}
X
ip netns exec phone wpa_supplicant -i wlan1 -c /tmp/phone.conf -B -P /tmp/phone.pid
began=$(now)
wait_for "joined" 'ip netns exec phone iw dev wlan1 link | grep -q "Connected"' 120 && result "phone joins|$(( $(now) - began )) s"
ip netns exec phone dhclient -1 -v -lf /tmp/leases -pf /tmp/dhclient.pid wlan1 >/tmp/dhcp.log 2>&1 || tail -5 /tmp/dhcp.log
wait_for "address" 'ip netns exec phone ip -4 addr show wlan1 | grep -q "inet 10.42.0"' 60
result "address|$(ip netns exec phone ip -4 -o addr show wlan1 | tr -s ' ' | cut -d' ' -f4)"
page() { # not busybox: its static wget dies in the name service
  ip netns exec phone "$PYTHON" -c 'import urllib.request as u; print(u.urlopen("http://10.42.0.1/pair", timeout=10).read().decode())' |
    grep -q borescout
}
wait_for "page" page 300 || { page; tail -20 /tmp/box.log; off; }
result "page on the phone|after $(( $(now) - begun )) s"
names() { ip netns exec phone "$PYTHON" - <<'X'
import random, socket, struct, urllib.request
def resolve(name):
    query = struct.pack("!6H", random.randrange(65536), 256, 1, 0, 0, 0)
    query += b"".join(bytes([len(part)]) + part.encode() for part in name.split(".")) + b"\0" + struct.pack("!2H", 1, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        asked.settimeout(5)
        asked.sendto(query, ("10.42.0.1", 53))
        answer = asked.recv(512)
    return ".".join(map(str, answer[-4:])) if answer[7] else "no answer"
for name, path in (("captive.apple.com", "/hotspot-detect.html"), ("connectivitycheck.gstatic.com", "/generate_204")):
    where = resolve(name)
    request = urllib.request.Request(f"http://{where}{path}", headers={"Host": name})
    answer = urllib.request.urlopen(request, timeout=10)
    print(f"RESULT {name}|{where}, status {answer.status}, {answer.read().decode()[-22:] or 'nothing'}")
print(f"RESULT example.org|{resolve('example.org')}")
X
}
names
result "a client is counted|$(iw dev wlan0 station dump | grep -c Station)"
# The radio falls silent; NetworkManager and its supplicant live on.
nm=$(pidof NetworkManager)
iw dev wlan0 ap stop || result "silence|not to be had"
began=$(now)
sleep 2
result "silent|radio says $(iw dev wlan0 info | tr -s '\n\t' ' ')"
said=$(nmcli -t -f NAME,DEVICE,STATE connection show --active | grep borescout)
result "NetworkManager says|$said, process $([ "$nm" = "$(pidof NetworkManager)" ] && echo lives || echo gone)"
wait_for "noticed" 'grep -q "the hotspot is silent" /tmp/box.log' 240 && result "noticed and started anew|after $(( $(now) - began )) s"
wait_for "restored" sends 240 && result "sends again|after $(( $(now) - began )) s"
wait_for "joined again" 'ip netns exec phone iw dev wlan1 link | grep -q Connected && page' 240 && result "phone has the page again|after $(( $(now) - began )) s"
kill -0 $box && result "the daemon|ran through"
grep -E "ERROR|Traceback" /tmp/box.log | head -5
off
