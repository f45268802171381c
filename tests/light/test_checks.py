"""A recording must be as large as the film, and the camera must see the object."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule
from evsdr.light.checks import check_film, check_object
from evsdr.light.scene import load_scene
from tests.support.small_scene import HEIGHT, WIDTH, scene


@pytest.fixture
def ring(tmp_path):
    (tmp_path / "scene.xml").write_text(scene())
    return load_scene(tmp_path / "scene.xml")


def test_a_recording_of_another_size_is_refused(ring):
    signal = np.zeros((2, HEIGHT, WIDTH), np.float32)
    same = record(signal, 0.1, EventPixel.ideal(), ring_schedule(2), 1)
    check_film(ring, same)
    turned = replace(same, sensor=replace(same.sensor, width=HEIGHT, height=WIDTH), source="a.h5")
    sentence = (
        f"scene.xml: the film is {WIDTH} x {HEIGHT} pixels but the events of a.h5 are {HEIGHT} x {WIDTH}"
    )
    with pytest.raises(InputError, match=sentence):
        check_film(ring, turned)


def test_an_object_out_of_sight_is_refused(ring):
    mask = np.zeros((HEIGHT, WIDTH), bool)
    with pytest.raises(InputError, match="scene.xml: the camera does not see the shape object"):
        check_object(ring, mask)
    mask[3, 2] = True
    check_object(ring, mask)
