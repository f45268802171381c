"""Biases, region and event-rate control of a camera under the vendor's SDK: set, and read back.

Names are those of the facilities of metavision_hal: I_LL_Biases, I_ROI, I_ErcModule.
"""

from dataclasses import dataclass

from evsdr.errors import InputError


@dataclass(frozen=True)
class CameraSettings:
    """What a camera shall do.

    Attributes
    ----------
    biases : tuple of (str, int)
        Name and value; those not named stay as they are.
    region : (int, int, int, int), optional
        Left, top, width and height of the pixels that may fire; None for as it is.
    event_rate : float, optional
        Most events in a second, beyond which the camera drops some; 0 switches the control off, None leaves it.
    """

    biases: tuple[tuple[str, int], ...] = ()
    region: tuple[int, int, int, int] | None = None
    event_rate: float | None = None


def parse_biases(texts: tuple[str, ...]) -> tuple[tuple[str, int], ...]:
    """Read texts `name=value`.

    Raises
    ------
    InputError
        One is something else.
    """
    pairs = [text.partition("=") for text in texts]
    for text, (name, _, value) in zip(texts, pairs):
        if not name or not value.removeprefix("-").isdecimal():
            raise InputError(f"--bias {text}: write name=value with a whole number, as bias_diff_on=20.")
    return tuple((name, int(value)) for name, _, value in pairs)


def set_up(hal, device, settings: CameraSettings) -> dict:
    """Set a camera up, and give what it then says of itself: all of its biases, region, event rate, where it has them.

    Parameters
    ----------
    hal : module
        metavision_hal.
    device
        An open camera.

    Raises
    ------
    InputError
        The camera has no such facility, or refuses a value.
    """
    biases, region, control = (
        _facility(device, name) for name in ("get_i_ll_biases", "get_i_roi", "get_i_erc_module")
    )
    for name, value in settings.biases:
        if biases is None or name not in biases.get_all_biases():
            raise InputError(f"the camera has no bias {name}; correct --bias.")
        if biases.set(name, value) is False:
            raise InputError(f"the camera refuses {name} = {value}; see its range in the vendor's manual.")
    if settings.region:
        window = region and hal.I_ROI.Window(*settings.region)
        if not region or region.set_window(window) is False or region.enable(True) is False:
            raise InputError(f"the camera refuses the region {settings.region}; correct --region.")
    if settings.event_rate is not None:
        is_on = settings.event_rate > 0
        if not control or (is_on and control.set_cd_event_rate(int(settings.event_rate)) is False):
            raise InputError(
                f"the camera refuses an event rate of {settings.event_rate:g}; leave --event-rate out."
            )
        control.enable(is_on)
    told = {
        "biases": dict(biases.get_all_biases()) if biases else None,
        "region": settings.region and list(settings.region),
        "event_rate": control.get_cd_event_rate() if control and control.is_enabled() else None,
    }
    return {name: value for name, value in told.items() if value is not None}


def _facility(device, name: str):
    """Give a facility, or None where this SDK or camera has none."""
    find = getattr(device, name, None)
    return find() if find else None
