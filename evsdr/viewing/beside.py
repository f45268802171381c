"""A preview beside a recording: starts its process, says where its page is, ends it."""

import importlib.util
import json
import select
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from evsdr.errors import InputError, InputWarning

START = "import sys; sys.path[:] = {path!r}; from evsdr.viewing.watcher import main; main()"
START_S = 30.0  # in which a preview must have started; the first time its loops are compiled
OPEN_S = 30.0  # that a recording waits for the page to be opened
END_S = 10.0  # for the last to be shown, on a busy machine


def check_preview(path: Path | None) -> None:
    """Refuse a preview that can't be: of no file, or without its library.

    Raises
    ------
    InputError
        So it is.
    """
    if path is None:
        raise InputError(
            "--preview follows the file that your camera software writes; name it by --recording, a RAW file."
        )
    if importlib.util.find_spec("websockets") is None:
        raise InputError(
            "websockets is not installed; install it by: python -m pip install 'evsdr[preview]'."
        )


@contextmanager
def beside(
    path: Path,
    order: tuple[int, ...],
    slot_us: float,
    crossfade: float,
    region: tuple[int, int, int, int] | None = None,
    wait_s: float = OPEN_S,
) -> Iterator[str]:
    """Show a recording while it is made; gives the address of the page, which is also printed, or nothing.

    Waits until somebody has opened the page, then leaves it to itself: whatever goes wrong there, only a warning comes.

    Parameters
    ----------
    path : Path
        RAW file that will grow.
    order, slot_us, crossfade
        Of the ring.
    region : (left, top, width, height), optional
        Of the sensor, that is shown.
    wait_s : float
        Longest time to wait [s].
    """
    told = {"path": str(path.absolute()), "title": path.parent.absolute().name, "order": order}
    told |= {"slot_us": slot_us, "crossfade": crossfade, "region": region}
    process = subprocess.Popen(
        [sys.executable, "-c", START.format(path=sys.path), json.dumps(told)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        address = _line(process, START_S)
        if address:
            print(f"preview: {address}", file=sys.stderr)
            print(f"The recording starts once it is open, or in {wait_s:.0f} s.", file=sys.stderr, flush=True)
            _line(process, wait_s)
        else:
            warnings.warn(
                InputWarning("the preview did not start; the recording goes on without."), stacklevel=3
            )
        yield address
    finally:
        _end(process)


def _line(process: subprocess.Popen, seconds: float) -> str:
    """Read a line that comes in time; nothing else."""
    end, text = time.monotonic() + seconds, b""
    while not text.endswith(b"\n"):
        if not select.select([process.stdout], [], [], max(end - time.monotonic(), 0))[0]:
            return ""
        part = process.stdout.read1(4096)
        if not part:
            return ""
        text += part
    return text.decode().strip()


def _end(process: subprocess.Popen) -> None:
    """Let the process show the last and end; if it does not, it is ended."""
    with suppress(OSError):
        process.stdin.close()
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    process.stdout.close()
