"""What came on a serial line and was no answer, for the error that would else say that nothing came."""

from __future__ import annotations

_SHOWN = 16


class Unread:
    """Bytes since the last question."""

    def __init__(self) -> None:
        self._count, self._first = 0, b""

    def clear(self) -> None:
        """Forget them: a question is asked, or was answered."""
        self._count, self._first = 0, b""

    def add(self, data: bytes) -> None:
        """Note what came."""
        self._count += len(data)
        self._first += data[: _SHOWN - len(self._first)]

    def said(self, *, cure: str) -> str:
        """The end of an error: how many bytes came and the first of them, and what to do.

        ``cure``: what to do where none came.
        """
        if not self._count:
            return f"no byte came; {cure}"
        text = "".join(chr(byte) if 32 <= byte < 127 else "." for byte in self._first)
        return (
            f"{self._count} bytes came that are no answer, the first: {self._first.hex(' ')} ({text!r}); are the ports "
            "of stage and laser exchanged, or is it another device, firmware or speed of the line?"
        )
