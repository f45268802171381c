"""Surface normals and absolute spectral reflectance from an event camera and a ring of LEDs.

What `__all__` names is imported when it is first used, so that `import evsdr` is cheap.
"""

import importlib
import sys
from importlib.machinery import PathFinder
from pathlib import Path

from evsdr.stale import forget_stale

__version__ = "0.1.0"

_HOME = {
    "Events": "records",
    "Sensor": "records",
    "Schedule": "records",
    "Recording": "records",
    "Maps": "records",
    "Truth": "records",
    "InputError": "errors",
    "InputWarning": "errors",
    "read_recording": "files.events_h5",
    "write_recording": "files.events_h5",
    "read_camera_file": "rig.reader",
    "read_results": "files.maps",
    "load_scene": "fitting.entrance",
    "EventPixel": "events.pixel",
    "record": "events.record",
    "simulate": "fitting.simulation",
    "Settings": "fitting.settings",
    "fit": "fitting.entrance",
    "Fit": "fitting.entrance",
    "score": "metrics",
    "angular_error_deg": "metrics",
}
__all__ = [*_HOME]


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Beside:
    """Finds `evsdr.integrators` and `evsdr.scenes` in a checkout, where they lie beside the package."""

    names = ("evsdr.integrators", "evsdr.scenes")
    checkout = Path(__file__).resolve().parent.parent

    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return PathFinder.find_spec(name, [str(cls.checkout)], target) if name in cls.names else None


if (_Beside.checkout / "pyproject.toml").is_file():  # a wheel carries them inside the package
    sys.meta_path.insert(0, _Beside)

forget_stale(Path(__file__).resolve().parent)
