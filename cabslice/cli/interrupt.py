"""Ctrl-C that is never lost: compiled or foreign code can swallow the exception, so it is remembered."""

from __future__ import annotations

import signal
import threading
from types import FrameType

_asked = threading.Event()


def watch() -> None:
    """Remember SIGINT from now on; only the main thread may ask for it."""
    _asked.clear()
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _remember)


def asked() -> bool:
    return _asked.is_set()


def heed() -> None:
    """Raise KeyboardInterrupt if one was swallowed."""
    if _asked.is_set():
        raise KeyboardInterrupt


def _remember(number: int, frame: FrameType | None) -> None:
    _asked.set()
    raise KeyboardInterrupt
