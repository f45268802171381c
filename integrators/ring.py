"""The `ring` integrator: every LED of a time-multiplexed ring in one pass, one channel each.

A channel is the signal I_xj = A_xj + C_w of a pixel x while LED j alone is lit:

    A_xj = pi INT D(lambda) L_xj(lambda) dlambda,

so that a white Lambertian patch that faces the LED gives INT D E_j. The integral is a Gauss quadrature of
the measure D E_j, with its four nodes in `si.wavelengths`; LEDs with spectra of the same shape share nodes. Where a
reflectance of the scene has an edge within a band, nodes are chosen that integrate all reflectances that
`mi.traverse` shows as values over wavelengths (three with edges in a band exactly, more as well as four nodes can);
they stay when a reflectance is changed. Lines narrower than 0.5 nm keep their power, but see reflectances to 0.5 nm.

Parameters in a scene file:

`constant_light` (float)
    C_w, a veil on the sensor that does not depend on the surface. Default 0. Differentiable.
`response` (spectrum)
    D, the camera's spectral response. Default 1.
`max_depth` (integer)
    Surface points on a light path: 1 is direct light (default), 2 one inter-reflection.
`unit` (string)
    Unit of the scene's lengths, um, mm, cm or m, for those who get the results. Default: not told.

For inverse problems `mi.traverse` also exposes two image-space textures, empty at first. Once they are set,
they take the place of the surface's normal and reflectance; the scene's geometry then only serves
visibility, direction and distance of the LEDs, and is traced once:

`normal` (tensor (H, W, 3))
    Normals in the camera frame (x right, y up, z toward the camera), of any length. Differentiable.
`reflectance` (tensor (H, W, n_band))
    Band reflectance. Differentiable.

What is changed in the scene is seen: LEDs, shapes and camera may be moved by `mi.traverse`, and are traced anew. With the
textures, signals also have derivatives by position, direction and power of the LEDs; without them, by what Mitsuba's
materials and emitters expose; in reverse, too, for any number of rays. Visibility has none: where a shadow's edge, the
object's outline or a far LED's horizon moves over a pixel, derivatives miss that change. Nor have shapes and camera with
the textures, as these lie on the image. An LED whose spectrum changes its shape may become a band of its own.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
from evsdr.integrators.emission import largest_spread, mean_vectors, recurrence, toward_led, with_surface
from evsdr.integrators.leds import Leds, find_leds, power_factor
from evsdr.integrators.pixels import pixel_mean, pixel_shift
from evsdr.integrators.rays import fineness, spawn, spawn_toward
from evsdr.integrators.values import is_of_led, is_of_scene, values_of

from evsdr.model.illumination import Illumination
from evsdr.model.lambert import led_signals
from evsdr.model.view import MILLIMETRES


class RingIntegrator(mi.SamplingIntegrator):
    """One channel per LED in one pass; see the module's text."""

    def __init__(self, props):
        super().__init__(props)
        self.constant_light = mi.Float(props.get("constant_light", 0.0))
        self.max_depth = props.get("max_depth", 1)
        self.unit = props.get("unit", "")
        self.response = props.get_unbounded_texture("response", 1.0)
        self.normal = mi.TensorXf(dr.zeros(mi.Float, 0), (0, 0, 3))
        self.reflectance = mi.TensorXf(dr.zeros(mi.Float, 0), (0, 0, 0))
        # What was found before, with what it was found from (see `values_of`). No key holds the scene: it holds the
        # integrator, and neither would be freed.
        self._leds = None  # (key, Leds)
        self._illumination = None  # (key, Illumination)
        if self.max_depth < 1:
            raise ValueError(f"ring: max_depth must be at least 1, got {self.max_depth}")
        if self.unit and self.unit not in MILLIMETRES:
            raise ValueError(f"ring: unit must be one of {', '.join(MILLIMETRES)}, got {self.unit}")

    # ------------------------------------------------------------------ plugin interface

    def traverse(self, callback):
        callback.put("constant_light", self.constant_light, mi.ParamFlags.Differentiable)
        callback.put("normal", self.normal, mi.ParamFlags.Differentiable)
        callback.put("reflectance", self.reflectance, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys):
        pass

    def aov_names(self):
        return []

    def to_string(self):
        return f"RingIntegrator[constant_light={self.constant_light}, max_depth={self.max_depth}]"

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        """Render the ring.

        Parameters
        ----------
        scene : mi.Scene
            Scene with emitters named `led...`.
        sensor : int or mi.Sensor
            Camera. Pixels are averaged over their area (box filter).
        seed : int
            Seed of the sampling.
        spp : int
            Rays per pixel; 1 goes through the pixel's centre. 0 takes the sampler's number.

        Returns
        -------
        mi.TensorXf, (H, W, n_led)
            Signals, constant light included. Differentiable in the traversed parameters.
        """
        sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
        spp = spp or sensor.sampler().sample_count()
        width, height = (int(n) for n in sensor.film().crop_size())
        if self.normal.shape[0] == 0:
            image = dr.moveaxis(self.signals(scene, sensor, spp, seed), 0, -1).array
        else:
            image = dr.ravel(mi.ArrayXf(self._textured_signals(scene, sensor, spp, seed)), order="F")
        dr.make_opaque(self.constant_light)  # else each value would be a kernel of its own
        image += self.constant_light
        if evaluate:
            dr.eval(image)
        return mi.TensorXf(image, (height, width, len(image) // (width * height)))

    # ------------------------------------------------------------------ forward: the scene's own surfaces

    def leds(self, scene) -> Leds:
        """Collect the LEDs of a scene; their spectra are read again when one of them has changed."""
        key = scene.emitters(), values_of(scene, is_of_led)
        if self._leds is None or self._leds[0] != key:
            with dr.suspend_grad():
                self._leds = (key, find_leds(scene, self.response))
        return self._leds[1]

    def signals(self, scene, sensor, spp, seed=0) -> mi.TensorXf:
        """Render A_xj by the scene's own surfaces.

        Returns
        -------
        mi.TensorXf, (n_led, H, W)
            Signals without the constant light.
        """
        leds, fine = self.leds(scene), fineness(scene)
        width, height = (int(n) for n in sensor.film().crop_size())
        lanes = leds.in_lanes(scene, width * height)
        n_copy = dr.width(lanes[0].number) // (width * height)
        shift = pixel_shift(sensor, seed, n_copy) if with_surface(leds) else None

        def measure(s, si, ray, rng, active):
            first = None if shift is None else recurrence(shift, s)
            return self._path_signals(scene, lanes, fine, si, ray, rng, active, first)

        signal = dr.concat(pixel_mean(scene, sensor, spp, seed, len(lanes), measure, n_copy))
        return mi.TensorXf(signal, (len(lanes) * n_copy, height, width))[: leds.n_led]

    def _path_signals(self, scene, leds, fine, si, ray, rng, active, first):
        """Signals of one camera ray: at every surface point of its path each LED is sampled, at `first` from the first."""
        context = mi.BSDFContext()
        throughput = [mi.Spectrum(led.weight) for led in leds]
        active = active & si.is_valid()
        signal = [mi.Float(0.0) for _ in leds]
        if not self.hide_emitters:
            # radiance relative to the LED's spectrum, where the camera looks right at it
            front, hit = active & (mi.Frame3f.cos_theta(si.wi) > 0), si.emitter(scene)
            signal = [dr.select(front & (hit == led.emitter), mi.Float(1.0), 0.0) for led in leds]
        for depth in range(self.max_depth):
            bsdf = si.bsdf(ray)
            sample = mi.Point2f(rng.next_float32(), rng.next_float32())
            sample = first if first is not None and depth == 0 else sample

            # Light: the same for all wavelengths of an LED but for its spectrum, which the weights hold.
            for k, led in enumerate(leds):
                ds, geometry = toward_led(led, si, sample, active)
                si.wavelengths = led.node_nm
                f_cos = bsdf.eval(context, si, si.to_local(ds.d), active & (geometry > 0))
                reflected = dr.sum(f_cos * throughput[k])
                lit = visible(scene, si, ds, active & (geometry * reflected > 0), fine)
                signal[k] += dr.select(lit, geometry * reflected, 0.0)
            if depth + 1 == self.max_depth:
                break

            # Next surface point: one direction serves all LEDs, each with its own throughput.
            choice, direction = rng.next_float32(), mi.Point2f(rng.next_float32(), rng.next_float32())
            for k, led in enumerate(leds):
                si.wavelengths = led.node_nm
                bs, weight = bsdf.sample(context, si, choice, direction, active)
                throughput[k] *= weight
            ray = spawn(si, si.to_world(bs.wo), fine)
            active &= bs.pdf > 0
            si = scene.ray_intersect(ray, mi.RayFlags.All, coherent=False, active=active)
            active &= si.is_valid()
        return [led.power * dr.pi * s for led, s in zip(leds, signal)]

    # ------------------------------------------------------------------ inverse: image-space textures

    def illumination(
        self, scene, sensor, spp, seed=0, shadows=True, skip=0.0
    ) -> tuple[Illumination, mi.Float]:
        """Trace what the LEDs send to each pixel of the shape `object`.

        Parameters
        ----------
        shadows : bool
            Trace cast shadows; else every LED is visible.
        skip : float
            Occluders nearer than that don't count [scene units]: on a mesh made of the pixels, facets would
            shadow each other.

        Returns
        -------
        Illumination
            Direction (camera frame) and irradiance V g INT D E_j of each LED, mean over the pixel's area and
            the LED's; of the latter only the visibility is sampled at random. V is the share of the light that other
            surfaces let pass, so 1 where all of a pixel faces away: its normal makes that dark, not a shadow.
        coverage : mi.Float, (H * W)
            Share of the pixel that the object covers.
        """
        leds = self.leds(scene)
        frame = camera_frame(sensor)
        far, wide = [leds.is_far(j) for j in range(leds.n_led)], with_surface(leds)
        target = find_object(scene)
        free = dr.opaque(mi.Float, skip) if skip > 0 else None  # no kernel holds its length
        fine, shift = fineness(scene), pixel_shift(sensor, seed)

        def measure(s, si, ray, rng, active):
            active = active & si.is_valid() & (si.shape == target)
            sample = mi.Point2f(rng.next_float32(), rng.next_float32())
            sample = recurrence(shift, s) if wide else sample
            values = [dr.select(active, mi.Float(1.0), 0.0)]
            values += list(dr.select(active, si.p, mi.Point3f(0.0))) if wide else []
            for j in range(leds.n_led):
                if not shadows and (far[j] or j in wide):
                    continue
                ds, geometry = toward_led(leds.one(j), si, sample, active)
                if shadows:
                    # what faces away from an LED is dark by its normal: it counts for no shadow
                    facing = dr.select(active, dr.maximum(dr.dot(si.sh_frame.n, ds.d), 0.0), 0.0)
                    facing *= geometry if j in wide else 1.0  # samples of a surface do not count alike
                    lit = visible(scene, si, ds, active & (facing > 0), fine, free)
                    values += [dr.select(lit, facing, 0.0), facing]
                if not far[j] and j not in wide:
                    arriving = rotate(frame, geometry * ds.d)
                    values += [norm(arriving), *arriving]
            return values

        n_value = 1 + 3 * bool(wide) + 2 * shadows * leds.n_led + 4 * (far.count(False) - len(wide))
        coverage, *value = pixel_mean(scene, sensor, spp, seed, n_value, measure)
        value = iter(dr.select(coverage > 0, v / dr.maximum(coverage, 1e-6), 0.0) for v in value)
        place = mi.Point3f(next(value), next(value), next(value)) if wide else None
        vectors = dict(zip(wide, mean_vectors(leds, wide, place))) if wide else {}
        vectors = {j: dr.select(coverage > 0, v, mi.Vector3f(0.0)) for j, v in vectors.items()}
        direction, irradiance = [], []
        for j, power in enumerate(leds.power.tolist()):
            visibility = mi.Float(1.0)
            if shadows:
                lit, facing = next(value), next(value)
                elsewhere = dr.select(coverage > 0, mi.Float(1.0), 0.0)
                visibility = dr.select(facing > 0, lit / dr.maximum(facing, 1e-20), elsewhere)
            if far[j]:
                toward, level = far_light(leds, j, frame)
            elif j in wide:
                level, toward = norm(vectors[j]), unit(rotate(frame, vectors[j]))
            else:
                level, toward = next(value), unit(mi.Vector3f(next(value), next(value), next(value)))
            direction.append(toward)
            irradiance.append(power * level * visibility)
            if dr.grad_enabled(irradiance[-1]):
                irradiance[-1] *= power_factor(leds, j, self.response)
        middle = next(s for s in scene.shapes() if s.id() == "object").bbox().center()
        bands, spread = [int(b) for b in leds.band], largest_spread(leds, middle)
        return Illumination(direction, irradiance, bands, self.constant_light, None, spread), coverage

    def _textured_signals(self, scene, sensor, spp, seed):
        """Signals by the image-space textures; the geometry's part is traced once, or with its derivatives."""
        if any(dr.grad_enabled(value) for name, value in mi.traverse(scene) if is_of_led(name)):
            illumination = self.illumination(scene, sensor, spp, seed)[0]
        else:
            illumination = self._traced(scene, sensor, spp, seed)
        height, width, n_band = self.reflectance.shape
        if self.normal.shape != (height, width, 3) or n_band != self.leds(scene).n_band:
            raise ValueError(
                f"ring: normal must have shape (H, W, 3) and reflectance (H, W, {self.leds(scene).n_band}), "
                f"got {self.normal.shape} and {self.reflectance.shape}"
            )
        normal = dr.unravel(mi.Vector3f, self.normal.array)
        normal *= dr.rsqrt(dr.maximum(dr.squared_norm(normal), 1e-20))  # a normal of length 0 gives no signal
        pixel = dr.arange(mi.UInt32, height * width)
        reflectance = [
            dr.gather(mi.Float, self.reflectance.array, pixel * n_band + b, mode=dr.ReduceMode.Permute)
            for b in range(n_band)
        ]
        return led_signals(illumination, normal, reflectance)

    def _traced(self, scene, sensor, spp, seed):
        """Give the illumination without derivatives; traced anew when seed, rays, or anything in the scene has changed."""
        seed_number = int(seed) if isinstance(seed, int) else int(seed[0])
        values = values_of(scene, is_of_scene), values_of(sensor)
        key = (scene.shapes(), scene.emitters(), sensor, *values, spp, seed_number)
        if self._illumination is None or self._illumination[0] != key:
            with dr.suspend_grad():
                self._illumination = (key, self.illumination(scene, sensor, spp, seed)[0])
        return self._illumination[1]


# ---------------------------------------------------------------------- building blocks


def far_light(leds: Leds, j: int, frame: np.ndarray) -> tuple[mi.Vector3f, mi.Float]:
    """Give direction (camera frame) and fall-off of an LED that is far: the same everywhere."""
    ds, geometry = toward_led(leds.one(j), dr.zeros(mi.SurfaceInteraction3f), mi.Point2f(0.5), mi.Bool(True))
    if dr.grad_enabled(ds.d):
        return rotate(frame, ds.d), geometry
    return mi.Vector3f(*(frame @ np.array(ds.d, float).ravel()).tolist()), geometry


def unit(v: mi.Vector3f) -> mi.Vector3f:
    """Give a vector's direction; that of no light is toward the camera."""
    length = norm(v)
    return dr.select(length > 0, v / dr.maximum(length, 1e-20), mi.Vector3f(0, 0, 1))


def norm(v) -> mi.Float:
    """Give the length of a vector; where it is 0, so is its derivative."""
    square = dr.squared_norm(v)
    return dr.select(square > 0, dr.sqrt(dr.select(square > 0, square, 1.0)), 0.0)


def visible(scene, si, ds, active, fine=None, skip=None) -> mi.Bool:
    """Trace a shadow ray from a surface point to a sampled LED; stretches `skip` at both ends are free."""
    ray = spawn_toward(si, ds, fine)
    if skip is not None:
        ray.o += mi.Vector3f(dr.sign(dr.dot(si.n, si.to_world(si.wi))) * si.n) * (0.25 * skip) + skip * ds.d
        ray.maxt -= 2 * skip  # as it starts later, and lest it reaches the LED's own shape
    return active & ~scene.ray_test(ray, True, active)


def camera_frame(sensor) -> np.ndarray:
    """Give the axes of the camera frame (right, up, toward the camera) in the world, as rows (3, 3).

    Mitsuba's own camera axes are left, up, away from the camera.
    """
    matrix = np.array(sensor.world_transform().matrix, float).reshape(4, 4)[:3, :3]
    axes = matrix / np.linalg.norm(matrix, axis=0)
    return np.array([-axes[:, 0], axes[:, 1], -axes[:, 2]])


def rotate(frame: np.ndarray, v: mi.Vector3f) -> mi.Vector3f:
    """Turn world vectors into the camera frame."""
    return mi.Vector3f(*(dr.dot(mi.Vector3f(*row), v) for row in frame.tolist()))


def find_object(scene) -> mi.ShapePtr:
    """Find the shape with the id `object`."""
    for shape in scene.shapes():
        if shape.id() == "object":
            return mi.ShapePtr(shape)
    raise ValueError("no shape has the id 'object'")


mi.register_integrator("ring", lambda props: RingIntegrator(props))
