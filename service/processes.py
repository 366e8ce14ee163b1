"""What our processes have in common: die with the parent, run as another user, end quickly."""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
import signal
from collections.abc import Callable

_PR_SET_PDEATHSIG = 1
_PR_SET_KEEPCAPS = 8
_PR_CAP_AMBIENT = 47
_PR_CAP_AMBIENT_RAISE = 2
_CAP_DAC_OVERRIDE = 1
_CAPABILITY_VERSION_3 = 0x20080522

_libc = ctypes.CDLL(None, use_errno=True)


class _CapHeader(ctypes.Structure):
    _fields_ = [("version", ctypes.c_uint32), ("pid", ctypes.c_int)]


class _CapData(ctypes.Structure):
    _fields_ = [
        ("effective", ctypes.c_uint32),
        ("permitted", ctypes.c_uint32),
        ("inheritable", ctypes.c_uint32),
    ]


def _check(result: int, what: str) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")


def die_with_parent(parent: int, with_signal: signal.Signals = signal.SIGKILL) -> None:
    """Have the kernel send this process ``with_signal`` when its parent ends.

    ``parent`` is the process id that the caller believes is its parent: if that one has ended
    already, this process ends at once. "Parent" is the *thread* that forked: fork from one that
    lives as long as its process.
    """
    _check(_libc.prctl(_PR_SET_PDEATHSIG, int(with_signal), 0, 0, 0), "PR_SET_PDEATHSIG")
    if os.getppid() != parent:
        os._exit(1)


def become(uid: int, gid: int) -> None:
    """Turn from root into an ordinary user who may still reach files wherever they lie.

    Keeps the one capability ``CAP_DAC_OVERRIDE`` (also across exec), so that no folder has to
    be opened to everyone just because it lies under root's home.
    """
    _check(_libc.prctl(_PR_SET_KEEPCAPS, 1, 0, 0, 0), "PR_SET_KEEPCAPS")
    os.setgroups([])
    os.setgid(gid)
    os.setuid(uid)
    mask = 1 << _CAP_DAC_OVERRIDE
    header = _CapHeader(_CAPABILITY_VERSION_3, 0)
    data = (_CapData * 2)(_CapData(mask, mask, mask), _CapData(0, 0, 0))
    _check(_libc.capset(ctypes.byref(header), data), "capset")
    _check(
        _libc.prctl(_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_RAISE, _CAP_DAC_OVERRIDE, 0, 0),
        "PR_CAP_AMBIENT_RAISE",
    )


def before_exec(
    with_signal: signal.Signals = signal.SIGKILL, user: tuple[int, int] | None = None
) -> Callable[[], None]:
    """A ``preexec_fn``: becomes ``user`` (uid, gid) if given, and dies with this process."""
    parent = os.getpid()

    def prepare() -> None:
        if user is not None:
            become(*user)
        die_with_parent(parent, with_signal)

    return prepare


def end_quickly() -> None:
    """Spare this process, at its end, the search for garbage in all that it has imported."""
    atexit.register(gc.freeze)
