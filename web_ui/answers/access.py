"""Who may do what."""

from web_ui.answers.base import Answer


class Party(Answer):
    """A paired device."""

    id: str
    name: str


class AskingParty(Party):
    """A paired device that asks for the control, and has it in `left_s` seconds without an answer."""

    left_s: float


class ControlState(Answer):
    """Who controls the box and who asks."""

    controller: Party | None
    request: AskingParty | None


class SessionState(Answer):
    """The own session: for who is paired also its `id`, `name`, `csrf`, and the state of the control."""

    paired: bool


class PairedSession(SessionState, ControlState):
    """The own session: `csrf` has to come with each change, as the header X-CSRF-Token."""

    id: str
    name: str
    csrf: str


class PairedDevice(Party):
    """One of those who are paired."""

    address: str
    controls: bool
    silent_s: float
