"""What every driver shares: the exceptions, one sentence each that an operator could read."""


class DriverError(Exception):
    """A sensor did not do what it was asked."""


class SensorMissing(DriverError):
    """No such sensor is plugged in, or its software is not installed."""


class SensorLost(DriverError):
    """The sensor was there and is gone."""


class FrameTimeout(DriverError):
    """The sensor sent nothing in the time allowed."""


class BadFrame(DriverError):
    """The sensor sent something that is not a frame."""


class EndOfRecording(DriverError):
    """The recording has been played to its end."""


class RecordingBroken(DriverError):
    """A recording cannot be read: its manifest, or a file it names, is missing or damaged."""
