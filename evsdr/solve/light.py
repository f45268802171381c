"""The light of a pixel at a phase of the ring, with its derivatives by the pixel's unknowns."""

from dataclasses import dataclass

import drjit as dr

from evsdr.solve.pair_data import PairData, Table, lit_leds


@dataclass(frozen=True)
class Light:
    """Light that is looked up.

    Attributes
    ----------
    table : Table
        See `derivative_table`.
    pairs : PairData
        For the LEDs of each slot.
    constant_light : Float
        C_w, above 0.
    n_band : int
        Number of bands.
    """

    table: Table
    pairs: PairData
    constant_light: object
    n_band: int

    def at(self, pixel, phase, active):
        """Give I."""
        lit = lit_leds(self.pairs, phase, active)
        return self.constant_light + sum(
            share * self.table.first_at(pixel, led, active & (share > 0)) for led, share in lit
        )

    def entries(self, pixel, phase, active):
        """Give the shares of the two LEDs that are lit, and what the table says of them."""
        lit = lit_leds(self.pairs, phase, active)
        return [(share, unpack_entry(self.table.at(pixel, led, active))) for led, share in lit]

    def of(self, lit):
        """Give I of what `entries` gives, and the derivatives of log I by p, q and log reflectances."""
        Float = type(self.constant_light)
        total = self.constant_light + sum(share * entry[0] for share, entry in lit)
        derivative = [Float(0.0) for _ in range(2 + self.n_band)]
        for share, (_, by_p, by_q, band, diffuse) in lit:
            part = share / total
            derivative[0] += part * by_p
            derivative[1] += part * by_q
            for b in range(self.n_band):
                derivative[2 + b] += dr.select(band == b, part * diffuse, 0.0)
        return total, derivative


def unpack_entry(entry):
    """Give signal, its slope derivatives, band and diffuse part of an entry of `derivative_table`."""
    signal, by_p, by_q, coded = entry
    band = dr.floor(coded)
    return signal, by_p, by_q, band, 2.0 * (coded - band) * signal
