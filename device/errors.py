"""What can go wrong in the box, each with one sentence for the operator."""

import math


class DeviceError(Exception):
    """The device could not do what it was asked. ``str()`` is the sentence to show."""

    code = "device"


class NotFound(DeviceError):
    """There is no such pipe, well or survey."""

    code = "not_found"


class Busy(DeviceError):
    """Something else is going on that has to end first."""

    code = "busy"


class Invalid(DeviceError):
    """What was given cannot be used."""

    code = "invalid"


class Forbidden(DeviceError):
    """Whoever asks may not do that."""

    code = "forbidden"


class WrongPin(DeviceError):
    """Not the PIN on the label. ``wait_s`` seconds pass before another one is looked at."""

    code = "wrong_pin"

    def __init__(self, wait_s: float = 0.0) -> None:
        self.wait_s = wait_s
        super().__init__("That is not the PIN on the label." + (f" Try again in {math.ceil(wait_s)} s." if wait_s > 0 else ""))


class TooSoon(DeviceError):
    """After wrong PINs the next one is not looked at for ``wait_s`` seconds."""

    code = "too_soon"

    def __init__(self, wait_s: float) -> None:
        self.wait_s = wait_s
        super().__init__(f"Too many wrong PINs: try again in {math.ceil(wait_s)} s.")


class StorageFull(DeviceError):
    """There is no room left for a finding."""

    code = "storage_full"


class StoreUnusable(DeviceError):
    """The data folder cannot be used: no permission, in use by another daemon, or written by a newer program."""

    code = "store_unusable"


class EstimateFailed(DeviceError):
    """An estimate did not come back from the workers."""

    code = "estimate_failed"


class Closed(DeviceError):
    """The device is shutting down."""

    code = "closed"
