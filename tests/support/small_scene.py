"""A small scene as text, to spoil in tests: a sphere before eight far LEDs of two bands."""

import math

WIDTH, HEIGHT = 16, 12  # film [pixels], not square so that a swap shows
SPECTRA = {"blue": (430, 450, 470), "red": (600, 620, 640), "ultraviolet": (250, 270, 290)}  # triangles [nm]
RING = '<integrator type="ring"><float name="constant_light" value="$constant_light"/></integrator>'
DIFFUSE = '<bsdf type="diffuse"><spectrum name="reflectance" value="430:0.3, 640:0.7"/></bsdf>'
SPHERE = f'<shape type="sphere" id="object">{DIFFUSE}</shape>'


def leds(
    n: int = 8, colours: tuple = ("blue", "red"), power: float = 1.0, distance: float | None = None
) -> str:
    """Write n LEDs at a polar angle of 45 degrees; a patch at the origin that faces one has `power` of it.

    They are far, or point lights at a distance.
    """
    lines = []
    for j in range(n):
        low, middle, high = SPECTRA[colours[j % len(colours)]]
        x, y, z = (c / 2**0.5 for c in (math.cos(2 * math.pi * j / n), math.sin(2 * math.pi * j / n), 1))
        if distance is None:
            kind, name, peak = "directional", "irradiance", power / 20
            place = f'<vector name="direction" x="{-x:.6f}" y="{-y:.6f}" z="{-z:.6f}"/>'
        else:
            kind, name, peak = "point", "intensity", power * distance**2 / 20
            place = f'<point name="position" x="{distance * x}" y="{distance * y}" z="{distance * z}"/>'
        spectrum = f'<spectrum name="{name}" value="{low}:0, {middle}:{peak:g}, {high}:0"/>'
        lines.append(f'<emitter type="{kind}" id="led_{j:03d}">{place}{spectrum}</emitter>')
    return "\n".join(lines)


def camera(
    name: str = "camera",
    kind: str = "orthographic",
    width: int = WIDTH,
    height: int = HEIGHT,
    wide: float = 1.4,
) -> str:
    """Write a camera that sees the unit sphere: x right, y up, z toward it, and so far to each side."""
    perspective = kind == "perspective"
    view = '<float name="fov" value="40"/>' if perspective else ""
    scale = "" if perspective else f'<scale x="{wide}" y="{wide}"/>'
    return f"""<sensor type="{kind}" id="{name}">{view}
        <transform name="to_world">{scale}<lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
            <rfilter type="box"/></film></sensor>"""


def scene(
    integrator: str = RING, sensor: str | None = None, light: str | None = None, shape: str = SPHERE
) -> str:
    """Write a scene.xml."""
    parts = (integrator, camera() if sensor is None else sensor, leds() if light is None else light, shape)
    default = '<default name="constant_light" value="0.05"/>' if "$" in integrator else ""
    return "\n".join(['<scene version="3.0.0">', default, *parts, "</scene>"])
