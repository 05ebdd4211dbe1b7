"""The one error of every codec."""


class CodecError(ValueError):
    """Bytes that are no message, or a value that no message can carry."""
