"""A scene file from a few figures of the camera, a table of LEDs and what is known of the object."""

from dataclasses import dataclass
from textwrap import indent
from xml.sax.saxutils import quoteattr

import numpy as np

from evsdr.errors import InputError
from evsdr.rig.led_light import square_form_factor
from evsdr.rig.led_table import Led
from evsdr.rig.led_xml import far_led, near_led, spectrum_xml, square_led

MARK = "Written by python -m evsdr.new_scene"  # by which a file is known that may be replaced
MARGIN = 1.05  # of a plane of unknown shape, over what the camera sees
AWAY = 5.0  # of an orthographic camera, in widths of its field; it changes nothing but what it stands behind


@dataclass(frozen=True)
class Camera:
    """A camera that looks down the z axis at the scene's origin.

    Attributes
    ----------
    size : (int, int)
        Width and height of the film [pixels].
    field : float
        Width of what the film sees at the origin [scene units].
    distance : float
        From the origin [scene units].
    perspective : bool
        Else orthographic.
    center : (float, float)
        Column and row of the optical axis [pixels]; the middle of the film for an orthographic camera.
    """

    size: tuple[int, int]
    field: float
    distance: float
    perspective: bool
    center: tuple[float, float]


def camera_of(
    size: tuple[int, int],
    field_width: float | None = None,
    focal_mm: float | None = None,
    pixel_um: float = 4.86,
    distance: float | None = None,
    center: tuple[float, float] | None = None,
) -> Camera:
    """Give the camera that a few figures tell.

    Parameters
    ----------
    size : (int, int)
        Width and height of the film, the sensor region [pixels].
    field_width : float, optional
        Width of what an orthographic camera sees [scene units].
    focal_mm, pixel_um : float, optional
        Focal length [mm] and width of a pixel [um] of a perspective camera.
    distance : float, optional
        From the camera to the scene's origin [scene units].
    center : (float, float), optional
        Column and row of the optical axis [pixels]; the middle if None.

    Raises
    ------
    InputError
        They tell no camera.
    """
    if not all(1 <= n <= 65536 for n in size):
        raise InputError(f"--size {size[0]} {size[1]} is no size; give width and height in pixels.")
    numbers = {"field-width": field_width, "focal-mm": focal_mm, "pixel-um": pixel_um, "distance": distance}
    for name, value in numbers.items():
        if value is not None and not 0 < value < 1e12:
            raise InputError(f"--{name} is {value:g}; give a number above 0.")
    middle = (size[0] / 2, size[1] / 2)
    if field_width is not None and focal_mm is None:
        if center is not None and tuple(center) != middle:
            raise InputError(
                "--center goes with --focal-mm; an orthographic camera looks straight at the origin."
            )
        return Camera(size, field_width, distance or AWAY * field_width, False, middle)
    if focal_mm is None or field_width is not None or distance is None:
        raise InputError("tell the camera by --field-width, or by --focal-mm, --pixel-um and --distance.")
    if center is not None and not np.abs(np.divide(np.subtract(center, middle), size)).max() < 100:
        raise InputError(
            f"--center {center[0]:g} {center[1]:g} is far from the film; give a column and a row."
        )
    field = size[0] * 1e-3 * pixel_um / focal_mm * distance
    return Camera(size, field, distance, True, tuple(center or middle))


def scene_xml(
    camera: Camera,
    leds: list[Led],
    constant_light: float = 0.05,
    unit: str | None = None,
    sphere: float | None = None,
    mesh: str | None = None,
) -> str:
    """Write a scene file.

    Parameters
    ----------
    camera : Camera
    leds : list of Led
        In schedule order.
    constant_light : float
        C_w, in the unit of the LEDs' powers.
    unit : str, optional
        Of all lengths: um, mm, cm or m.
    sphere : float, optional
        Radius of the object, a sphere around the origin.
    mesh : str, optional
        Instead: name of its mesh, a PLY or OBJ file. Without either its shape is unknown.
    """
    parts = [
        f'<default name="constant_light" value="{constant_light:g}"/>',
        _integrator(unit),
        _camera(camera),
        *_leds(leds),
        _object(camera, sphere, mesh),
    ]
    body = indent("\n\n".join(parts), "    ")
    return f'<scene version="3.0.0">\n    <!-- {MARK}. Lengths are in one unit. -->\n\n{body}\n</scene>\n'


def _integrator(unit: str | None) -> str:
    told = f'\n    <string name="unit" value="{unit}"/>' if unit else ""
    return f'<integrator type="ring">\n    <float name="constant_light" value="$constant_light"/>{told}\n</integrator>'


def _camera(camera: Camera) -> str:
    width, height = camera.size
    scale = (
        ""
        if camera.perspective
        else f'        <scale x="{camera.field / 2:.9g}" y="{camera.field / 2:.9g}"/>\n'
    )
    lens = ""
    if camera.perspective:
        angle = 2 * np.degrees(np.arctan(camera.field / (2 * camera.distance)))
        lens = f'    <float name="fov" value="{angle:.9g}"/>\n    <string name="fov_axis" value="x"/>\n'
        for axis, at, n in zip("xy", camera.center, camera.size):
            lens += f'    <float name="principal_point_offset_{axis}" value="{0.5 - at / n:.9g}"/>\n'
    return (
        f'<sensor type="{"perspective" if camera.perspective else "orthographic"}" id="camera">\n'
        '    <transform name="to_world">\n'
        f"{scale}"
        f'        <lookat origin="0, 0, {camera.distance:.9g}" target="0, 0, 0" up="0, 1, 0"/>\n'
        "    </transform>\n"
        f'{lens}    <float name="near_clip" value="{1e-3 * camera.distance:.6g}"/>\n'
        f'    <float name="far_clip" value="{1e3 * camera.distance:.6g}"/>\n'
        '    <film type="hdrfilm">\n'
        f'        <integer name="width" value="{width}"/>\n'
        f'        <integer name="height" value="{height}"/>\n'
        '        <rfilter type="box"/>\n'
        "    </film>\n"
        "</sensor>"
    )


def _leds(leds: list[Led]) -> list[str]:
    """Write spectra, each once, then the LEDs."""
    spectra: dict[tuple, str] = {}
    parts = []
    for j, led in enumerate(leds):
        factor, position = led.power, None
        if led.distance is not None:
            position = led.distance * led.direction
            factor *= led.distance**2
        if led.size:
            factor = led.power / (np.pi * square_form_factor(led.size, led.distance))
        name = f"led_{j:0{max(2, len(str(len(leds) - 1)))}d}"
        key = (led.wavelength_nm.tobytes(), (factor * led.density).tobytes())
        spectrum = spectra.setdefault(key, f"light_{len(spectra)}")
        if led.size:
            parts.append(square_led(name, spectrum, position, led.size))
        else:
            parts.append(
                far_led(name, spectrum, led.direction)
                if position is None
                else near_led(name, spectrum, position)
            )
    written = [
        spectrum_xml(np.frombuffer(nm), np.frombuffer(value), id=name)
        for (nm, value), name in spectra.items()
    ]
    return written + parts


def _object(camera: Camera, sphere: float | None, mesh: str | None) -> str:
    if sphere is not None:
        return f'<shape type="sphere" id="object">\n    <float name="radius" value="{sphere:.9g}"/>\n    <bsdf type="diffuse"/>\n</shape>'
    if mesh is not None:
        kind = "obj" if mesh.lower().endswith(".obj") else "ply"
        return (
            f'<shape type="{kind}" id="object">\n    <string name="filename" value={quoteattr(mesh)}/>\n'
            '    <bsdf type="diffuse"/>\n</shape>'
        )
    pixel = camera.field / camera.size[0]
    x, y = (MARGIN * pixel * max(at, n - at) for at, n in zip(camera.center, camera.size))
    return (
        '<!-- Its shape is unknown: a plane stands for it. -->\n<shape type="rectangle" id="object">\n'
        f'    <transform name="to_world">\n        <scale x="{x:.9g}" y="{y:.9g}"/>\n    </transform>\n'
        '    <bsdf type="diffuse"/>\n</shape>'
    )
