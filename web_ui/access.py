"""Which routes need what: everything is private unless it is named here (a test walks the URL map).

A route that is not named needs a session to be read, and the control of the box to change something.
"""

PUBLIC = frozenset(
    {
        "static",  # scripts and styles, the same in every box
        "pages.pair",
        "pages.favicon",
        "pages.robots",
        "session.state",  # tells the caller of itself alone
        "session.pair",
        "api.document",
        "captive.probe",  # a fixed word each, the same in every box
        "captive.no_content",
    }
)
"""Endpoints that answer without a session."""

ANY_HOST: frozenset[str] = frozenset({"captive.probe", "captive.no_content"})
"""Public endpoints that answer under any host name: what phones ask to find out whether a network has a portal."""

WATCHERS_MAY = frozenset(
    {
        "session.leave",
        "session.ask",
        "session.grant",  # the rules of the control are device.access's
        "session.refuse",
        "session.release",
        "api.clock",  # taken only where the box has no better time
    }
)
"""Changes that need a session but not the control."""

if not ANY_HOST <= PUBLIC:
    raise ValueError("a route under any host name has to be public")
