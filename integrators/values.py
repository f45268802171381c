"""What a scene's parameters are now, so that what was found from them can tell whether they have changed."""

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass(frozen=True, eq=False)
class Values:
    """Parameters as they were.

    Attributes
    ----------
    mark : tuple
        Names, with numbers, or with the places of arrays in Dr.Jit's memory.
    held : tuple
        Those arrays: no other takes the place of one that is held.
    """

    mark: tuple
    held: tuple

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Values) and self.mark == other.mark


def is_of_led(name: str) -> bool:
    """Tell whether a parameter is that of an LED."""
    return name.startswith("led")


def is_of_scene(name: str) -> bool:
    """Tell whether a parameter is not one of the integrator's own."""
    return not name.startswith("integrator.")


def values_of(node, chosen: Callable[[str], bool] = lambda name: True) -> Values:
    """Give the parameters of a scene, or of a part of it, that `mi.traverse` exposes and that are chosen by name."""
    mark, held = [], []
    for name, value in mi.traverse(node):
        if chosen(name):
            mark.append(name)
            for leaf in _leaves(value):
                is_jit = dr.is_jit_v(leaf)
                mark.append(leaf.index if is_jit else leaf)
                held += [type(leaf)(leaf)] if is_jit else []  # itself it would follow the scene
    return Values(tuple(mark), tuple(held))


def _leaves(value):
    """Take a value apart into arrays of one dimension, and numbers."""
    if not dr.is_array_v(value) and hasattr(value, "matrix"):  # arrays swizzle: they have one, too
        value = value.matrix
    if dr.is_tensor_v(value):
        value = value.array
    if dr.is_array_v(value) and (dr.depth_v(value) > 1 or not dr.is_jit_v(value)):
        for part in value:
            yield from _leaves(part)
    else:
        yield value
