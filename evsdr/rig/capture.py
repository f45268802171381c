"""Record the ring with a camera."""

import json
from collections.abc import Callable
from pathlib import Path

from evsdr.files.atomic import atomic_path
from evsdr.rig.camera import Camera
from evsdr.rig.driver import Ring, RingSettings
from evsdr.rig.log import write_ring_log

POLL_S = 0.1
RECORDING = "recording.raw"  # what a camera writes itself


def run_to_end(ring: Ring, n_round: int, progress: Callable[[str, float], None] | None = None) -> None:
    """Run a configured ring until its rounds are done; `progress` gets the round and the share done."""
    ring.start()
    while not ring.wait(POLL_S):
        if progress:
            done = ring.log.rounds_done
            progress(f"round {done + 1}", done / n_round)


def capture(
    camera: Camera,
    open_ring: Callable[[], Ring],
    settings: RingSettings,
    folder: Path,
    run: Callable[[Ring, int], None] = run_to_end,
) -> tuple[Path, Path]:
    """Run the ring while a camera records.

    The camera records before the ring starts and until after it ends. Whatever goes wrong, the ring ends dark.

    Parameters
    ----------
    camera : Camera
        What records.
    open_ring : callable () -> Ring
        Gives the ring, which is dark when it is left.
    settings : RingSettings
        What the ring shall do; its rounds have an end.
    folder : Path
        Made if missing; gets recording.raw, if the camera itself writes a file, ring.json, and camera.json with what the
        camera says of itself, if it does.
    run : callable (ring, n_round) -> None
        Runs the ring to its end.

    Returns
    -------
    recording, log : Path
        The camera's file and ring.json.

    Raises
    ------
    InputError
        Camera or ring fail.
    """
    with open_ring() as ring:
        ring.configure(settings)
        folder.mkdir(parents=True, exist_ok=True)
        camera.start(folder / RECORDING)
        try:
            run(ring, settings.rounds)
        except BaseException:
            camera.abandon()
            raise
    recording, log = camera.stop(), folder / "ring.json"
    write_ring_log(log, ring.log)
    if told := getattr(camera, "told", None):
        with atomic_path(folder / "camera.json") as temporary:
            temporary.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    return recording, log
