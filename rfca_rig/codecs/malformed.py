"""The only exceptions that codecs raise: a frame that cannot be read, or a value that a frame cannot carry."""

from rfca_rig.errors import DeviceError


class MalformedFrame(DeviceError):
    """Bytes that do not follow the protocol."""


class NotEncodable(DeviceError):
    """A value outside the range of its field in a frame."""
