"""What a codec raises, whatever the bytes: a frame that cannot be read, or a value that a frame cannot carry."""

from rfca_rig.errors import DeviceError


class MalformedFrame(DeviceError):
    """Bytes that are not what the protocol says they should be."""


class NotEncodable(DeviceError):
    """A value outside what the field of a frame can carry."""
