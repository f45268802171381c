"""`python -m experiments.bench.board`: write firmware/netlist.csv, what is wired to what, by the firmware's pins."""

import csv
import re
import sys
from pathlib import Path

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
NETLIST, PARTS = FIRMWARE / "netlist.csv", FIRMWARE / "parts.csv"
N_LED = 24
OUTPUTS = 8  # of a chip
TLC5916 = {"GND": 1, "SDI": 2, "CLK": 3, "LE": 4, "OE": 13, "SDO": 14, "R-EXT": 15, "VDD": 16} | {
    f"OUT{n}": 5 + n for n in range(OUTPUTS)
}  # data sheet SLVS695, pin configuration
CHAINS = ("EVEN", "ODD")
TRIGGERS = ("ROUND", "SLOT")

Wire = tuple[str, str, str, str]  # net, part, pin, its name


def firmware_pins(text: str) -> dict[str, str]:
    """Give the pin of the Uno of each signal, as pins.h tells it."""
    found = re.findall(r"#define (\w+) _BV\(P\w\d\)\s*/\* ([AD]\d+)\b", text)
    return dict(found)


def netlist() -> list[Wire]:
    """Give all wires, net by net."""
    wires = [*uno(), *chips(), *resistors(), *triggers(), *lamp()]
    return sorted(wires, key=lambda wire: (wire[0], wire[1], wire[2]))


def uno() -> list[Wire]:
    """Give the wires at the Uno: its signals, and the supply of all."""
    pins = firmware_pins((FIRMWARE / "pins.h").read_text())
    return [(net, "A1", pin, pin) for net, pin in pins.items()] + [
        ("5V", "A1", "5V", "5V"),
        ("GND", "A1", "GND", "GND"),
    ]


def chips() -> list[Wire]:
    """Give the wires at the shift registers, two to a chain, and at their LEDs and capacitors."""
    wires = []
    for chain, name in enumerate(CHAINS):
        for place in range(2):
            chip = f"U{1 + 2 * chain + place}"
            data = f"DATA_{name}" if place == 0 else f"NEXT_{name}"
            nets = {"GND": "GND", "VDD": "5V", "SDI": data, "CLK": "CLOCK", "LE": "LATCH", "OE": f"OE_{name}"}
            nets |= {"R-EXT": f"REXT_{chip}"} | ({"SDO": f"NEXT_{name}"} if place == 0 else {})
            for output in range(OUTPUTS):
                led = 2 * (OUTPUTS * place + output) + chain
                if led < N_LED:
                    nets[f"OUT{output}"] = f"LED_{led}"
                    wires += [
                        (f"LED_{led}", f"D{led + 1}", "K", "cathode"),
                        ("5V", f"D{led + 1}", "A", "anode"),
                    ]
            wires += [(net, chip, str(TLC5916[pin]), pin) for pin, net in nets.items()]
            wires += two_ends(f"R{chip[1]}", f"REXT_{chip}", "GND") + two_ends(f"C{chip[1]}", "5V", "GND")
    return wires


def resistors() -> list[Wire]:
    """Give what holds output enables, latch and gate where the Uno does not, and the supply's capacitor."""
    return [
        *two_ends("R5", "OE_EVEN", "5V"),
        *two_ends("R6", "OE_ODD", "5V"),
        *two_ends("R7", "LATCH", "GND"),
        *two_ends("R8", "LIGHT", "GND"),
        *two_ends("C5", "5V", "GND"),
    ]


def triggers() -> list[Wire]:
    """Give the dividers of the trigger outputs, and the plug of the camera."""
    wires = [("GND", "J1", "3", "ground")]
    for k, name in enumerate(TRIGGERS):
        wires += two_ends(f"R{9 + 2 * k}", name, f"{name}_3V3") + two_ends(
            f"R{10 + 2 * k}", f"{name}_3V3", "GND"
        )
        wires += [(f"{name}_3V3", "J1", str(1 + k), name.lower())]
    return wires


def lamp() -> list[Wire]:
    """Give the wires of the constant light."""
    wires = [("LIGHT", "Q1", "G", "gate"), ("GND", "Q1", "S", "source"), ("LAMP", "Q1", "D", "drain")]
    return wires + [
        ("LAMP", "D25", "K", "cathode"),
        ("LAMP_A", "D25", "A", "anode"),
        *two_ends("R13", "5V", "LAMP_A"),
    ]


def two_ends(part: str, first: str, second: str) -> list[Wire]:
    """Give the wires of a part with two ends."""
    return [(first, part, "1", ""), (second, part, "2", "")]


def parts() -> list[dict[str, str]]:
    """Read parts.csv."""
    with PARTS.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def names(row: dict[str, str]) -> list[str]:
    """Give the designators of a row of parts.csv."""
    return row["designators"].split(" ")


def write(path: Path) -> None:
    """Write the netlist."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("net", "part", "pin", "name"))
        writer.writerows(netlist())


if __name__ == "__main__":
    write(NETLIST)
    print(NETLIST)
    sys.exit(0)
