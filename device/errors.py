"""What can go wrong in the box, each with one sentence for the operator."""


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
