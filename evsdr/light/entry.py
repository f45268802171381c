"""The way in: start Mitsuba if nobody has, then load a scene."""

from pathlib import Path
from typing import TYPE_CHECKING

from evsdr import jit

if TYPE_CHECKING:
    from evsdr.light.scene import RingScene


def open_scene(path: str | Path | dict, define: dict[str, str] | None = None) -> "RingScene":
    """Load a scene as `evsdr.light.scene.load_scene` does, and start Mitsuba before if nobody has.

    Parameters
    ----------
    path : str, Path or dict
        A scene.xml, or a dictionary as of `mitsuba.load_dict`.
    define : dict, optional
        Values for the file's `<default>` parameters.

    Raises
    ------
    InputError
        Mitsuba can't be started, or the file is missing or wrong.
    """
    jit.start()
    from evsdr.light import scene  # late: it takes the types of the variant that runs

    return scene.load_scene(path, define)
