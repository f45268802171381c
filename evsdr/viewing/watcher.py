"""The process of a preview: it follows the file that a camera writes, and shows it on a page.

It is a process of its own, which only reads, gives way to all others, and skips what it is too late for: whatever becomes of
it, the recording goes on. It prints the page's address, and `open` once somebody looks; it ends when its standard input does.
"""

import json
import os
import signal
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.records import Schedule
from evsdr.rig.camera_file import crop
from evsdr.rig.growing import Growing, warm_up
from evsdr.viewing.moment import moment
from evsdr.viewing.server import Server, text_of
from evsdr.viewing.sums import Sums

EVERY_S = 0.2  # between two looks at the file
NICENESS = 10


class Watcher:
    """Follows a file.

    Parameters
    ----------
    path : Path
        RAW file that grows.
    schedule : Schedule
        As the ring is told.
    region : (left, top, width, height), optional
        Of the sensor, that is shown.
    """

    def __init__(self, path: Path, schedule: Schedule, region: tuple[int, int, int, int] | None = None):
        self._growing, self._schedule, self._region = Growing(path), schedule, region
        self._sums: Sums | None = None

    def close(self) -> None:
        """Close the file."""
        self._growing.close()

    def look(self, ended: bool = False) -> dict:
        """Take what has come; gives what there is to show."""
        piece, trouble = self._growing.take(), self._growing.trouble
        if piece is not None:
            try:
                piece = crop(piece, *self._region) if self._region else piece
                self._sums = self._sums or Sums(self._schedule, piece.width, piece.height)
                self._sums.add(piece)
            except InputError as error:
                trouble = str(error)
        return moment(self._sums, self._growing.skipped, trouble, ended)


def watch(watcher: Watcher, server: Server, ended: threading.Event) -> None:
    """Show what comes, until it has ended."""
    while not ended.wait(EVERY_S):
        server.newest.put(text_of(watcher.look()))
    server.newest.put(text_of(watcher.look(ended=True)), ended=True)


def main() -> None:
    """Run as a process; a signal to the whole group is the host's business."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    with suppress(OSError):
        os.nice(NICENESS)
    told = json.loads(sys.argv[1])
    schedule = Schedule(np.array(told["order"], np.int32), told["slot_us"], told["crossfade"])
    watcher, ended = Watcher(Path(told["path"]), schedule, told["region"]), threading.Event()
    warm_up()
    with Server(told["title"]) as server:
        print(server.address, flush=True)
        threading.Thread(target=tell_opened, args=(server,), daemon=True).start()
        threading.Thread(target=watch_host, args=(ended,), daemon=True).start()
        watch(watcher, server, ended)
    watcher.close()


def tell_opened(server: Server) -> None:
    """Tell the host once that somebody looks."""
    server.opened.wait()
    print("open", flush=True)


def watch_host(ended: threading.Event) -> None:
    """Wait until the host closes its end."""
    sys.stdin.buffer.read()
    ended.set()
