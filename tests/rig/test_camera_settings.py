"""Biases, region and event-rate control of a camera that is not there."""

from types import SimpleNamespace

import pytest

from evsdr.errors import InputError
from evsdr.rig.camera import SdkCamera, open_camera
from evsdr.rig.camera_settings import CameraSettings, parse_biases, set_up

HAL = SimpleNamespace(I_ROI=SimpleNamespace(Window=lambda *of: of))


class Device:
    """A camera whose facilities remember what they are told."""

    def __init__(self):
        self.biases, self.window, self.rate, self.limited = (
            {"bias_diff_on": 0, "bias_fo": 5},
            None,
            10**7,
            True,
        )

    def get_i_ll_biases(self):
        def put(name, value):
            if abs(value) < 100:
                self.biases[name] = value
            return abs(value) < 100

        return SimpleNamespace(get_all_biases=lambda: self.biases, set=put)

    def get_i_roi(self):
        return SimpleNamespace(
            set_window=lambda w: setattr(self, "window", w), enable=lambda on: w_fits(self.window)
        )

    def get_i_erc_module(self):
        return SimpleNamespace(
            set_cd_event_rate=lambda rate: setattr(self, "rate", rate),
            get_cd_event_rate=lambda: self.rate,
            enable=lambda on: setattr(self, "limited", on),
            is_enabled=lambda: self.limited,
        )


def w_fits(window):
    return window[0] + window[2] <= 1280


def test_what_is_set_is_read_back():
    device = Device()
    settings = CameraSettings(parse_biases(("bias_diff_on=-20",)), (8, 16, 64, 48), 5e6)
    told = set_up(HAL, device, settings)
    assert told == {
        "biases": {"bias_diff_on": -20, "bias_fo": 5},
        "region": [8, 16, 64, 48],
        "event_rate": 5_000_000,
    }
    assert device.window == (8, 16, 64, 48)
    assert "event_rate" not in set_up(HAL, device, CameraSettings(event_rate=0.0)) and not device.limited


def test_a_camera_that_tells_nothing_stays_as_it_is():
    assert set_up(HAL, SimpleNamespace(), CameraSettings()) == {}


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (CameraSettings((("bias_x", 1),)), "has no bias bias_x"),
        (CameraSettings((("bias_fo", 500),)), "refuses bias_fo = 500"),
        (CameraSettings(region=(1270, 0, 64, 48)), "refuses the region"),
    ],
)
def test_what_the_camera_refuses(settings, sentence):
    with pytest.raises(InputError, match=sentence):
        set_up(HAL, Device(), settings)


@pytest.mark.parametrize("text", ["bias_fo", "=3", "bias_fo=1.5", "bias_fo=x"])
def test_biases_are_names_and_whole_numbers(text):
    with pytest.raises(InputError, match="write name=value with a whole number"):
        parse_biases((text,))


def test_settings_need_the_sdk():
    with pytest.raises(InputError, match="are set by the vendor's SDK"):
        open_camera("manual", settings=CameraSettings(event_rate=1e6))
    assert SdkCamera(HAL).told == {}
