"""What a scene must fit: the recording, and its own camera."""

import numpy as np

from evsdr.errors import InputError
from evsdr.light.scene import RingScene
from evsdr.records import Recording


def check_film(ring: RingScene, recording: Recording) -> None:
    """Refuse a recording whose sensor region is not as large as the scene's film.

    Raises
    ------
    InputError
        It is not.
    """
    size = (recording.sensor.width, recording.sensor.height)
    if size != (ring.width, ring.height):
        raise InputError(
            f"{ring.path}: the film is {ring.width} x {ring.height} pixels but the events of {recording.source} "
            f"are {size[0]} x {size[1]}; make the film as large as the sensor region."
        )


def check_object(ring: RingScene, mask: np.ndarray) -> None:
    """Refuse a scene whose camera does not see the object; `mask` holds the pixels that do.

    Raises
    ------
    InputError
        There are none.
    """
    if not mask.any():
        raise InputError(f"{ring.path}: the camera does not see the shape object; move one of them.")
