"""The port of a servo maker's own library, with a script at its far end."""


class ScriptedLine:
    """``answer`` is there as soon as something was written; ``written`` is what was."""

    is_using = False

    def __init__(self, answer: bytes) -> None:
        self.written = b""
        self._answer = answer

    def clearPort(self) -> None:
        """Nothing waits before the question."""

    def writePort(self, packet: list[int]) -> int:
        self.written = bytes(packet)
        return len(packet)

    def readPort(self, length: int) -> bytes:
        data, self._answer = self._answer[:length], self._answer[length:]
        return data

    def setPacketTimeout(self, _length: int) -> None:
        """It never has to wait."""

    def isPacketTimeout(self) -> bool:
        return not self._answer
