"""What is wired to what: the netlist and the list of parts against the firmware."""

import re

import pytest

from experiments.bench import board, simulator

WIRES = board.netlist()
ENDS = {(part, pin): net for net, part, pin, _ in WIRES}


@pytest.fixture(autouse=True, scope="module")
def checkout():
    if not board.NETLIST.is_file():
        pytest.skip("no folder firmware")


def others(net, part):
    return {other for name, other, _, _ in WIRES if name == net and other != part}


def row_of(part):
    return next(row for row in board.parts() if part in board.names(row))


def ohms(part):
    number, unit = row_of(part)["value"].split(" ")[:2]
    return float(number) * {"ohm": 1, "kohm": 1000}[unit]


def test_the_file_is_what_the_firmware_says(tmp_path):
    board.write(tmp_path / "netlist.csv")
    assert (tmp_path / "netlist.csv").read_text() == board.NETLIST.read_text()
    text = (simulator.FIRMWARE / "pins.h").read_text()
    assert len(board.firmware_pins(text)) == text.count("_BV(") == 9


def test_every_pin_has_one_wire_and_every_net_two_ends():
    assert len(ENDS) == len(WIRES)
    for net in set(ENDS.values()):
        assert sum(name == net for name in ENDS.values()) >= 2, net
    for chip in ("U1", "U2", "U3", "U4"):
        free = set(map(str, range(1, 17))) - {pin for part, pin in ENDS if part == chip}
        assert free <= {str(board.TLC5916[f"OUT{n}"]) for n in range(4, 8)} | {"14"}  # the second of a chain


def test_all_have_the_uno_for_their_only_supply():
    fed = others("5V", "A1")
    assert {"U1", "U2", "U3", "U4", "R5", "R6", *(f"D{n}" for n in range(1, 25))} <= fed
    assert {net for net in ENDS.values() if net[0].isdigit()} == {"5V"}
    assert ohms("R5") == ohms("R6") == 10_000
    assert others("OE_EVEN", "") == {"A1", "R5", "U1", "U2"} and others("OE_ODD", "") == {
        "A1",
        "R6",
        "U3",
        "U4",
    }


def test_led_j_is_output_j_half_of_chain_j_mod_2():
    for led in range(24):
        chip, output = led // 16 + 1 + 2 * (led % 2), led // 2 % 8
        assert (
            ENDS[f"U{chip}", str(board.TLC5916[f"OUT{output}"])] == ENDS[f"D{led + 1}", "K"] == f"LED_{led}"
        )


def test_the_list_of_parts_is_complete_and_no_led_gets_more_than_it_bears():
    listed = [name for row in board.parts() for name in board.names(row)]
    assert sorted(listed) == sorted({part for part, _ in ENDS})
    most_ma = 1.06 * 15 * 1250 / ohms("R1")
    header = (simulator.FIRMWARE / "currents.h").read_text()
    assert re.search(r"\[0 \.\.\. N_LED - 1\] = 255\}", header)  # none is held back
    assert all(float(row_of(f"D{n}")["most_ma"]) >= most_ma for n in range(1, 25))
    assert 2 * most_ma <= 41  # two LEDs at once


def test_the_camera_gets_no_more_than_3v4_and_no_less_than_a_high_level():
    for upper, lower, net in (("R9", "R10", "ROUND"), ("R11", "R12", "SLOT")):
        share = ohms(lower) / (ohms(upper) + ohms(lower))
        assert 5.25 * share < 3.4 and 4.4 * share > 2.4
        assert ENDS[upper, "1"] == net and ENDS[upper, "2"] == ENDS[lower, "1"] and ENDS[lower, "2"] == "GND"
        assert "J1" not in others(net, "A1")
