"""What a camera's recording holds, for a user who does not know yet how the ring ran."""

import numpy as np

from evsdr.rig.camera_file import CameraRecording
from evsdr.rig.repetition import Repetition


def rows(camera: CameraRecording) -> list[tuple[str, str]]:
    """Give lines of a table: size, events, edges of each trigger input, and after which time events repeat."""
    events, edges = camera.events, camera.edges
    first, last = events.t[[0, -1]]
    seconds = 1e-6 * (last - first)
    pixel = np.zeros((camera.height, camera.width), bool)
    pixel[events.y, events.x] = True
    told = [
        ("sensor", f"{camera.width} x {camera.height} pixels"),
        ("events", f"{len(events):,}"),
        ("time", f"{1e-6 * first:.6f} s to {1e-6 * last:.6f} s"),
        ("events per second, mean", f"{1e-6 * len(events) / max(seconds, 1e-6):.3g} M"),
        ("ON events", f"{events.p.mean():.1%}"),
        ("pixels that fire", f"{pixel.mean():.1%}"),
    ]
    for name, polarity in (("rising", 1), ("falling", 0)):
        for number in np.unique(edges.id[edges.p == polarity]):
            t = edges.t[(edges.p == polarity) & (edges.id == number)]
            apart = f", {1e-3 * np.median(np.diff(t)):.6g} ms apart" if len(t) > 1 else ""
            told.append((f"trigger input {number}, {name}", f"{len(t):,} from {1e-6 * t[0]:.6f} s{apart}"))
    if not len(edges):
        told.append(("triggers", "none"))
    period_us, _ = Repetition(events, (camera.height, camera.width)).shortest()
    return told + [("events repeat every", f"about {1e-3 * period_us:.4g} ms" if period_us else "not found")]
