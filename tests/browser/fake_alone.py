"""What happened while nobody looked, of the device without cameras, as a test sets it."""

from typing import Any

from device.autonomy.loop import told

Json = dict[str, Any]


def line(number: int, what: str, survey_id: int | None = None, reason: str = "", at: str | None = None) -> Json:
    """One line of the journal."""
    return {"id": number, "what": what, "survey_id": survey_id, "reason": reason, "at": at, "at_s": 10.0 * number, "boot": "b"}


class FakeAlone:
    """`journal` are lines without their sentences."""

    logs_by_itself: bool = False
    looked: int = 0
    journal: tuple[Json, ...] = ()
    held: tuple[str, ...] = ()

    def autonomy(self) -> Json:
        state = "off" if not self.logs_by_itself else "held" if self.held else "waiting"
        news = sum(entry["id"] > self.looked and entry["what"] not in ("on", "off") for entry in self.journal)
        return {"on": self.logs_by_itself, "state": state, "survey_id": None, "holds": list(self.held), "news": news}

    def unattended(self) -> Json:
        return {
            "autonomy": self.autonomy(),
            "unsafe_shutdowns": sum(entry["what"] == "cut" for entry in self.journal),
            "looked_at": self.looked,
            "entries": told(self.journal),
        }

    def log_by_itself(self, on: bool) -> Json:
        self.logs_by_itself = on
        return self.autonomy()

    def look_at_journal(self, entry: int) -> None:
        self.looked = entry
