"""What phones ask, right after joining a network, to find out whether it is of any use: answered as they hope.

A hotspot without the internet has no good answer. Where these fail, Android and Windows leave for another network in the middle
of a survey; where they are redirected, iOS opens the page in its portal window, which forgets everything and drops the network
when it is closed. So there is no portal: the phone stays, and finds the page by the QR code on the label.
"""

from flask import Blueprint, Response, request

_SUCCESS_PAGE = "<HTML><HEAD><TITLE>Success</TITLE></HEAD><BODY>Success</BODY></HTML>"
PROBES: dict[str, tuple[str, str]] = {
    "/hotspot-detect.html": (_SUCCESS_PAGE, "text/html"),  # captive.apple.com
    "/library/test/success.html": (_SUCCESS_PAGE, "text/html"),  # www.apple.com, older iOS
    "/connecttest.txt": ("Microsoft Connect Test", "text/plain"),  # www.msftconnecttest.com
    "/ncsi.txt": ("Microsoft NCSI", "text/plain"),  # www.msftncsi.com
    "/success.txt": ("success\n", "text/plain"),  # detectportal.firefox.com
    "/canonical.html": (  # detectportal.firefox.com
        '<meta http-equiv="refresh" content="0;url=https://support.mozilla.org/kb/captive-portal"/>',
        "text/html",
    ),
    "/check_network_status.txt": ("NetworkManager is online\n", "text/plain"),  # nmcheck.gnome.org
    "/nm": ("NetworkManager is online\n", "text/plain"),  # network-test.debian.org
}
"""Path -> body, content type, byte for byte what the makers' own servers say."""
NO_CONTENT = ("/generate_204", "/gen_204")
"""Android and Chrome, at a dozen names: status 204 and nothing else."""


def blueprint() -> Blueprint:
    """The routes, public and under any host name (see ``access``); they say nothing of the box."""
    captive = Blueprint("captive", __name__)

    def probe() -> Response:
        body, mimetype = PROBES[request.path]
        return Response(body, mimetype=mimetype)

    def no_content() -> Response:
        return Response(status=204)

    for path in PROBES:
        captive.add_url_rule(path, view_func=probe)
    for path in NO_CONTENT:
        captive.add_url_rule(path, view_func=no_content)
    return captive
