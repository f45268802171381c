"""The ring's firmware on a simulated ATmega328P: timing, light, protocol, safety, and the whole loop."""

import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from evsdr.rig.driver import Ring, RingSettings
from evsdr.rig.protocol import frame
from experiments.bench import simulator
from experiments.bench.__main__ import run_settings
from experiments.bench.darkness import ENDINGS, SUPPLY, end_early
from experiments.bench.fuzz import fuzz
from experiments.bench.light import carrier_khz, edge_error_us, light_error, read_trace, stray_pulses
from experiments.bench.simulator import Script
from experiments.bench.vcd import read_changes
from tests.conftest import REPOSITORY

pytestmark = pytest.mark.skipif(simulator.missing() is not None, reason=f"no bench: {simulator.missing()}")


@pytest.fixture(scope="module", autouse=True)
def built():
    simulator.build()


def words(lines):
    """Give the answers without their numbers."""
    return [line.answer.split(" ", 1)[1] for line in lines if line.answer and line.answer[0] != "#"]


def ask(*commands):
    return words(Script().ask(*commands).run())


def test_hard_slots_start_on_time(tmp_path):
    settings = RingSettings(slot_us=200, crossfade=0.0, rounds=50, sync_slots=True)
    trace = run_settings(settings, tmp_path)
    by_trigger, by_light, n_slot = edge_error_us(trace, settings)
    assert n_slot == 50 * 24 and len(trace.rounds) == 51
    assert by_trigger <= 1 / 16 and by_light <= 0.125  # a cycle, and one for the carrier's dark cycle
    assert stray_pulses(trace, settings) == 0
    assert carrier_khz(trace) == (62.5, 62.5)


TRIM = tuple(np.linspace(0.2, 1, 24))
SETTINGS = {
    "crossfade 1": RingSettings(slot_us=5000, rounds=1),
    "shortest slots": RingSettings(slot_us=200, rounds=10),
    "longest first period": RingSettings(slot_us=223, rounds=10, crossfade=0.6),
    "fade of all periods but one": RingSettings(slot_us=207, rounds=10, crossfade=0.9),
    "fade of one period": RingSettings(slot_us=208, rounds=10, crossfade=0.05),
    "trim": RingSettings(slot_us=1003, crossfade=0.4, rounds=2, trim=TRIM),
    "dark and repeated slots": RingSettings((0, -1, 2, 2, 3, -1, -1, 5, 4, -1), 1500, 1.0, 3, TRIM),
    "256 slots": RingSettings(10 * tuple(range(24)) + tuple(range(16)), 300, 0.5, 2),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_light_follows_the_schedule(name, tmp_path):
    settings = SETTINGS[name]
    trace = run_settings(settings, tmp_path)
    assert len(trace.rounds) == settings.rounds + 1
    assert max(light_error(trace, settings)) <= 0.005
    assert stray_pulses(trace, settings) == 0
    round_cycles = 16 * settings.slot_us * len(settings.order)
    assert np.array_equal(np.diff(trace.rounds), np.full(settings.rounds, round_cycles))
    assert not len(trace.slots)


def test_48_leds_on_three_chips_per_chain(tmp_path):
    order = 5 * tuple(range(48)) + tuple(range(16))
    settings = RingSettings(order, 200, 1.0, 1, tuple(np.linspace(0.2, 1, 48)))
    trace = run_settings(settings, tmp_path, simulator.build(48))
    assert np.array_equal(np.diff(trace.rounds), [16 * 200 * 256])
    assert max(light_error(trace, settings)) <= 0.005 and stray_pulses(trace, settings) == 0
    assert set(np.concatenate([pulses.led for pulses in trace.pulses])) >= set(range(48))


def test_hard_switch_within_a_chain_is_dark_for_one_period(tmp_path):
    settings = RingSettings((0, 2, 2, -1, 4, 3, 1, -1), 1500, 0.0, 3)
    trace = run_settings(settings, tmp_path)
    steady, first = light_error(trace, settings)
    assert steady <= 0.005 and first == pytest.approx(1, abs=0.01)
    assert stray_pulses(trace, settings) == 0


def test_light_stays_right_under_a_flood_of_garbage(tmp_path):
    settings = RingSettings(slot_us=1000, rounds=4)
    rng = np.random.default_rng(0)
    script = Script().ask("SLOT 1000 1000000", "ROUNDS 4", "RUN")
    for _ in range(25):
        garbage = rng.integers(0, 256, 150, np.uint8).tobytes() + b"\n" + frame("1 STATUS")
        script.add(f"send {garbage.hex()}", "wait 3800")  # the line hardly ever rests
    lines = script.add("wait 20000").ask("STATUS").run(tmp_path / "pins.vcd")
    assert words(lines)[-1] == "OK run=0 rounds=4 light=0 cause=done"
    trace = read_trace(tmp_path / "pins.vcd")
    assert stray_pulses(trace, settings) == 0
    assert max(light_error(trace, settings)) <= 0.005


@pytest.mark.parametrize(
    "flood, end",
    [
        (b"x", "light=0 cause=alive"),  # no line ends
        (b"x\n", "light=0 cause=alive"),  # all are spoiled
        (frame("1 HELLO"), "light=0 cause=none"),  # each wants the longest answer
    ],
)
def test_a_flood_in_the_shortest_slots_does_no_harm(flood, end):
    script = Script().ask(
        "SLOT 207 900000", "ROUNDS 0", "RUN"
    )  # all of these the processor has the least time
    for _ in range(15):
        data = (300 * flood)[:300]
        script.add(f"send {data.hex()}", f"wait {20 * len(data)}")
    lines = script.beat().add("send 0a", "wait 100000").ask("STATUS").add("wait 9000").run()
    assert sum(line.text == "reset" for line in lines) == 1
    assert next(text for text in reversed(words(lines)) if "run=" in text).endswith(end)


@pytest.mark.parametrize("ending", ENDINGS)
def test_all_is_dark_in_time(ending, tmp_path):
    us, lines = end_early(ending, vcd=tmp_path / "pins.vcd")
    at_once = {"stop": 1000, "reset": 0, "reset, then the bootloader": 0}
    falls = {name: 3000 for name in SUPPLY}
    silent = {"host silent": 42_000, "cable pulled": 42_000, "host silent, ALIVE 49": 50_000}
    assert us <= {**at_once, **falls, **silent}.get(ending, 20_000)
    goes_on = {"stop", "supply sags to 3.5 V", *silent}
    assert (sum(line.text == "reset" for line in lines) > 1) == (ending not in goes_on)
    time_cycles, value = read_changes(tmp_path / "pins.vcd")[0]["light"]
    assert list(value) == ([0, 1] if ending == "stop" else [0, 1, 0])  # the constant light stays only then


@pytest.mark.parametrize("ending", ["USB unplugged", "USB unplugged and plugged in"])
def test_a_supply_of_their_own_would_light_the_leds_of_a_dead_uno(ending):
    assert end_early(ending, apart_mv=5000)[0] == np.inf


def test_reset_is_told():
    lines = Script().add("hang", "wait 50000").ask("STATUS").run()
    notices = [line.answer for line in lines if line.answer and line.answer[0] == "#"]
    assert [notice.split("reset=")[1] for notice in notices] == ["1 cause=power", "8 cause=hang"]
    assert words(lines) == ["OK run=0 rounds=0 light=0 cause=none"]


@pytest.mark.parametrize("what, cause", [("reset", "button"), ("hang", "hang"), ("rail 3500", "supply")])
def test_a_bootloader_that_clears_the_register_does_not_hide_the_cause(what, cause):
    script = Script().ask("LIGHT 1").add("boot 100000", what, "wait 1000")
    if cause == "supply":
        script.add("rail 2600", "wait 1000", "rail 5000")
    script.add("wait 120000")
    notices = [line.answer for line in script.run() if line.answer and line.answer[0] == "#"]
    assert [notice.split("reset=")[1] for notice in notices] == ["1 cause=power", f"0 cause={cause}"]


def test_constant_light_goes_out_with_the_host(tmp_path):
    script = Script().beat().ask("LIGHT 1").add("wait 100000").ask("STATUS").add("beat 0", "wait 60000")
    lines = script.ask("STATUS").run(tmp_path / "pins.vcd")
    assert [text.split("light=")[1][0] for text in words(lines)[1:]] == ["1", "0"]
    change, _ = read_changes(tmp_path / "pins.vcd")
    time_cycles, value = change["light"]
    on_ms = np.diff(time_cycles)[-1] / 16_000
    assert list(value) == [0, 1, 0] and 100 < on_ms < 165


def test_longest_light_is_enforced():
    lines = Script().ask("ORDER A", "SLOT 900000 0", "ROUNDS 0").beat().ask("RUN").add("wait 3000000").run()
    lit, dark = (next(line.t_us for line in lines if line.text == text) for text in ("lit", "dark"))
    assert dark - lit == pytest.approx(1_800_000, abs=20)
    script = Script().ask("ORDER A", "SLOT 900000 0", "ROUNDS 0").beat().ask("RUN").add("wait 3000000")
    assert words(script.ask("STATUS").run())[-1] == "OK run=0 rounds=1 light=0 cause=limit"


def test_commands_are_answered():
    assert ask("HELLO") == ["OK evsdr-ring-1.1 protocol=1 leds=24 slots=256 alive_ms=40 max_on_us=2000000"]
    assert ask("SLOT 200 1000000", "SLOT 1000000 500000") == [
        "OK periods=12 extra=128 fade=12",
        "OK periods=62500 extra=0 fade=31250",
    ]
    assert set(
        ask("ORDER .", "ORDER " + 64 * "A", "TRIM " + 24 * "0F", "ROUNDS 999999999", "SYNC 0", "MORE 64 BC")
    ) == {"OK"}


@pytest.mark.parametrize(
    "command",
    [
        "SLOT 199 0", "SLOT 1000001 0", "SLOT 1000 1000001", "SLOT 1000", "SLOT 1000 0 0", "SLOT -1 0", "ORDER",
        "ORDER Y", "ORDER a", "MORE 0 A", "MORE 25 A", "MORE 24 Y", "ALIVE 9", "ALIVE 50", "TRIM FF", "TRIM " + 24 * "fg", "TRIM " + 24 * "FF" + "F",
        "ROUNDS 1000000000", "ROUNDS 99999999999999", "ROUNDS", "SYNC 2", "LIGHT 2", "RUN now", "STOP now", "HELLO x",
    ],
)  # fmt: skip
def test_arguments_that_make_no_sense(command):
    refused, status, slot = ask(command, "STATUS", "SLOT 10000 1000000")
    assert refused == "ERR 4 bad argument"
    assert status == "OK run=0 rounds=0 light=0 cause=none" and slot == "OK periods=625 extra=0 fade=625"


def test_errors_have_numbers():
    assert ask("ORDER AC", "RUN", "JUMP", "run") == [
        "OK", "ERR 6 neighbours in order", "ERR 3 unknown command", "ERR 3 unknown command",
    ]  # fmt: skip
    spoiled = frame("1 STATUS").replace(b"STATUS", b"STATUZ")
    long = 200 * b"A" + b"\n"
    lines = Script()
    for data in (spoiled, long, b"\n\r\n\r", b"1 STATUS\n", frame("x STATUS"), frame(""), frame("1 STATUS")):
        lines.add(f"send {data.hex()}", "answer 5000")
    assert words(lines.run()) == [
        "ERR 1 checksum", "ERR 2 line too long", "ERR 1 checksum", "ERR 4 bad argument", "ERR 4 bad argument",
        "OK run=0 rounds=0 light=0 cause=none",
    ]  # fmt: skip


def test_settings_stay_during_a_run_and_run_comes_once():
    script = Script().ask("SLOT 1000 0", "ROUNDS 3").add(f"send {frame('7 RUN').hex()}", "wait 10000")
    script.add(f"send {frame('7 RUN').hex()}", "answer 20000").ask("RUN", "SLOT 2000 0", "TRIM " + 24 * "00")
    lines = script.beat().add("wait 100000").ask("STATUS").run()
    assert words(lines)[2:] == ["OK", "OK", *3 * ["ERR 5 busy"], "OK run=0 rounds=3 light=0 cause=done"]
    assert sum(line.text == "lit" for line in lines) == 1


def test_spoiled_lines_do_no_harm():
    result = fuzz(2000, seed=5)
    assert result.refused == [] and result.dark and result.longest_us <= 50_000
    assert result.runs >= 5 and result.answers >= 1500


# ---- with the host beside it --------------------------------------------------------------------------


@pytest.mark.parametrize("what, ended", [("reset", "reset"), ("hang", "reset"), ("cut", "lost")])
def test_host_learns_how_a_run_broke_off(what, ended, tmp_path):
    with simulator.beside_host(tmp_path / "pins.vcd") as (port, bench):
        with Ring(port) as host:
            host.configure(RingSettings(slot_us=1000, rounds=0))
            host.start()
            threading.Timer(0.3, lambda: bench.stdin.write(f"{what}\n")).start()
            assert host.wait(20)
            assert host.log.ended == ended
            bench.stdin.write("join\n")
    trace = read_trace(tmp_path / "pins.vcd")
    last = max(pulses.stop[-1] for pulses in trace.pulses)
    assert trace.end - last > 16_000  # dark for a millisecond at least


def test_host_that_dies_leaves_the_ring_dark(tmp_path):
    code = (
        "import os, sys\nfrom evsdr.rig.driver import Ring, RingSettings\n"
        "ring = Ring(sys.argv[1]).__enter__()\nring.configure(RingSettings(slot_us=1000, rounds=0))\n"
        "ring.start()\nring.wait(0.1)\nos._exit(9)\n"
    )
    with simulator.beside_host() as (port, bench):
        subprocess.run([sys.executable, "-c", code, port], cwd=REPOSITORY, check=False, timeout=60)
        time.sleep(1.5)  # longer than the bench is patient
        with Ring(port) as host:
            assert host.status()["cause"] == "alive"


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore:the recording"
)  # a trim that is not told looks like LEDs that were swapped
def test_from_the_host_to_normals(tmp_path):
    from experiments.bench.loop import TRIMMED, close_loop

    error = close_loop(tmp_path, REPOSITORY / "scenes" / "sphere.xml", 24, TRIMMED, 1, "fast")
    assert error.ideal_deg < 0.5
    assert error.ring_deg <= 1.15 * error.ideal_deg
    assert error.untold_deg > 2 * error.ring_deg
