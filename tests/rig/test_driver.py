"""The host's side of the ring, against a ring in Python over a line that may be bad."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.commands import ring
from evsdr.errors import InputError
from evsdr.rig import driver, protocol
from evsdr.rig.driver import Ring, RingSettings, blinking, flickering
from evsdr.rig.log import parse_ring_log
from evsdr.rig.protocol import frame
from tests.conftest import REPOSITORY
from tests.support.fake_ring import FakeRing

SHORT = RingSettings(slot_us=1000, rounds=2)


def refuse(capsys, *argv):
    """Run the command on what it must refuse; gives its sentence."""
    assert ring.main([str(word) for word in argv]) == 2
    captured = capsys.readouterr()
    assert re.fullmatch(r"error: \S.*[^.]\.\n", captured.err)
    return captured.err


def sent(fake, *but):
    """Give the commands that came, but some; what came again because its answer was late only once."""
    commands = [command for command in fake.commands if command.split(" ")[0] not in (*but, "ALIVE")]
    return [command for k, command in enumerate(commands) if k == 0 or command != commands[k - 1]]


def wait_for(condition):
    """Wait until a callable says yes, but not for ever."""
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end, "it does not happen"
        time.sleep(0.01)


def test_run_sends_settings_and_logs(tmp_path):
    trim = (0.5, *(1.0,) * 23)
    settings = RingSettings((0, 1, -1), 1000, 0.4, 2, trim, constant_light=True, sync_slots=True)
    with FakeRing() as fake:
        with Ring(fake.port) as host:
            log = host.run(settings).as_json()
        commands = sent(fake, "STATUS", "STOP", "HELLO")
    assert commands[:7] == [
        "SLOT 1000 400000", "ORDER AB.", "TRIM 80" + 23 * "FF", "ROUNDS 2", "SYNC 1", "LIGHT 1", "RUN",
    ]  # fmt: skip
    assert commands[7:] == ["LIGHT 0"] and not fake.light
    assert log["ended"] == "done" and log["rounds_done"] == 2 and log["firmware"] == "fake protocol 1"
    assert log["trim"][:2] == [128 / 255, 1.0] and log["constant_light"] and log["sync_slots"]
    assert log["crossfade"] == pytest.approx(25 * 256 / 16000)  # 25 of 62 periods
    assert [text for _, text in log["log"]] == ["start", "round 1 complete", "round 2 complete", "done"]
    assert np.all(np.diff([seconds for seconds, _ in log["log"]]) >= 0)
    assert parse_ring_log(log).n_round == 2


def test_the_ring_is_kept_alive():
    with FakeRing() as fake, Ring(fake.port):
        wait_for(lambda: fake.commands.count("STATUS") >= 10)


@pytest.mark.parametrize("kind", ["lost bytes", "other bytes", "garbage between", "lost lines"])
def test_a_bad_line_does_no_harm(kind):
    rng = np.random.default_rng(1)

    def spoil(line):
        data = bytearray(line)
        if kind == "garbage between":
            return (
                bytes(rng.integers(0, 256, 40, np.uint8))
                + b"\n"
                + 1000 * b"x"
                + b"\n"
                + frame("0 OK late")
                + line
            )
        if rng.random() < 0.3:
            if kind == "lost lines":
                return b""
            at = rng.integers(len(data))
            data[at : at + 1] = b"" if kind == "lost bytes" else bytes([data[at] ^ 4])
        return bytes(data)

    with FakeRing() as fake:
        fake.spoil = spoil
        if kind == "garbage between":  # on its way to the host only: the ring's parser has its own tests
            fake.spoil = lambda line: line if line[:1].isdigit() and b"OK" not in line else spoil(line)
        with Ring(fake.port) as host:
            assert host.run(SHORT).ended == "done"
        assert not fake.lit and fake.commands.count("RUN") >= 1


def test_a_run_that_is_stopped():
    with FakeRing() as fake, Ring(fake.port) as host:
        host.configure(RingSettings(slot_us=1000, rounds=0))
        host.start()
        wait_for(lambda: host.log.rounds_done >= 2)
        assert not host.wait(0)
        with pytest.raises(InputError, match="runs already"):
            host.start()
        host.stop()
        assert not fake.lit
        assert host.log.ended == "stopped" and host.log.rounds_done >= 2


def test_reset_in_mid_run_is_noticed():
    with FakeRing() as fake, Ring(fake.port) as host:
        host.configure(RingSettings(slot_us=1000, rounds=0))
        host.start()
        wait_for(lambda: host.log.rounds_done >= 2)
        fake.reset()
        assert host.wait(2)
        assert host.log.ended == "reset" and host.log.rounds_done >= 2
        assert "BOOT fake protocol=1 reset=2" in [text for _, text in host.log.lines]


@pytest.mark.parametrize("cause", ["alive", "limit", "late"])
def test_a_ring_that_goes_dark_by_itself_is_noticed(cause):
    with FakeRing() as fake, Ring(fake.port) as host:
        host.configure(RingSettings(slot_us=1000, rounds=0))
        host.start()
        fake.cause, fake.lit = cause, False
        assert host.wait(2)
        assert host.log.ended == "watchdog"
        silence = r", \d+ ms without a line to it" if cause == "alive" else ""
        assert re.fullmatch(rf"watchdog \({cause}{silence}\)", host.log.lines[-1][1])


def test_a_lost_ring_does_not_hang_the_host(monkeypatch):
    monkeypatch.setattr(protocol, "LOST_S", 0.2)
    with FakeRing() as fake:
        with Ring(fake.port) as host:
            host.configure(RingSettings(slot_us=1000, rounds=0))
            host.start()
            fake.silent = True
            assert host.wait(2)
            assert host.log.ended == "lost"
            with pytest.raises(InputError, match="lost"):
                host.status()


def test_an_exception_ends_dark():
    with FakeRing() as fake:
        with pytest.raises(ZeroDivisionError), Ring(fake.port) as host:
            host.configure(RingSettings(slot_us=1000, rounds=0, constant_light=True))
            host.start()
            assert fake.lit and fake.light
            raise ZeroDivisionError
        assert not fake.lit and not fake.light
        with Ring(fake.port) as host:  # and the port is free again
            assert host.run(SHORT).ended == "done"


def test_another_version_is_refused(capsys):
    with FakeRing(protocol=2) as fake:
        assert "version 2" in refuse(capsys, "status", "--port", fake.port)


def test_no_ring_answers(capsys, monkeypatch):
    monkeypatch.setattr(driver, "BOOT_S", 0.2)
    with FakeRing() as fake:
        fake.silent = True
        assert "no ring answers" in refuse(capsys, "status", "--port", fake.port)


def test_a_ring_of_another_size_is_refused():
    orders = driver.order_commands(tuple(range(48)) * 5)
    assert [command[:10] for command in orders] == ["ORDER ABCD", "MORE 96 AB", "MORE 192 A"]
    assert sum(len(command.split(" ")[-1]) for command in orders) == 240 and orders[0].endswith("tuv")
    with FakeRing() as fake, Ring(fake.port) as host:
        with pytest.raises(InputError, match="has 24 LEDs and up to 256 slots, not 48 and 2"):
            host.configure(RingSettings((0, 47), trim=(1.0,) * 48))


def test_no_such_port(capsys):
    assert "/dev/nowhere" in refuse(capsys, "run", "--port", "/dev/nowhere")


def port(device, vid, pid):
    return SimpleNamespace(device=device, vid=vid, pid=pid)


def test_the_port_is_found(monkeypatch):
    ports = [port("tty0", None, None), port("tty1", 0x2341, 0x0043), port("tty2", 0x1A86, 0x1111)]
    monkeypatch.setattr(driver.list_ports, "comports", lambda: ports)
    assert ring.find_port() == "tty1"
    ports.append(port("tty3", 0x1A86, 0x7523))
    with pytest.raises(InputError, match="tty1, tty3"):
        ring.find_port()
    ports[:] = ports[:1]
    with pytest.raises(InputError, match="--port"):
        ring.find_port()


@pytest.mark.parametrize(
    "words, field",
    [
        ("--order 0 24", "order"),
        ("--order " + "0 1 " * 129, "order"),
        ("--order 0 2", "LED 0 fade into LED 2"),
        ("--order 0 1 2", "LED 2 fade into LED 0"),
        ("--slot-us 199", "slot_us"),
        ("--slot-us 1000.5", "slot_us"),
        ("--crossfade 1.1", "crossfade"),
        ("--rounds -1", "rounds"),
        ("--trim 1 1", "trim"),
        ("--order 3 --rounds 3 --slot-us 1000000", "longer than 2 s"),
        ("--order 0 0 1 --slot-us 1000000", "longer than 2 s"),
    ],
)
def test_settings_that_cannot_be(words, field, capsys):
    assert field in refuse(capsys, "run", "--port", "/dev/nowhere", *words.split())


@pytest.mark.parametrize(
    "settings",
    [
        dict(order=(3,), rounds=2, slot_us=1e6, crossfade=0.0),
        dict(order=(0, 2), crossfade=0.0),
        dict(order=(0, 1, -1), slot_us=1e6),
        dict(order=(0, -1, 2, 2, 3)),
    ],
)
def test_settings_that_can_be(settings):
    RingSettings(**settings)


def test_command_runs_and_writes_the_log(tmp_path, capsys):
    with FakeRing() as fake:
        path = tmp_path / "ring.json"
        words = ["run", "--port", fake.port, "--slot-us", "1000", "--rounds", "2", "--log", str(path)]
        assert ring.main(words) == 0
        assert json.loads(path.read_text())["ended"] == "done"
        assert ring.main(["status", "--port", fake.port]) == 0
        assert "fake protocol 1" in capsys.readouterr().out
        assert ring.main(["stop", "--port", fake.port]) == 0
    assert [entry.name for entry in tmp_path.iterdir()] == ["ring.json"]


def test_command_tests_each_led(capsys, monkeypatch):
    with FakeRing(round_s=0.001) as fake:
        monkeypatch.setattr(ring, "TEST_US", 300)
        assert ring.main(["test", "--port", fake.port]) == 0
        orders = sent(fake, "STATUS", "STOP", "HELLO", "SLOT", "TRIM", "ROUNDS", "SYNC", "LIGHT", "RUN")
    assert orders == [f"ORDER {chr(ord('A') + led)}" for led in range(24)]
    assert "LED 23, odd chain" in capsys.readouterr().out


def test_command_tells_of_a_run_that_broke_off(tmp_path, capsys):
    with FakeRing() as fake:
        path = tmp_path / "ring.json"
        timer = threading.Timer(0.5, fake.reset)
        timer.start()
        sentence = refuse(capsys, "run", "--port", fake.port, "--rounds", "0", "--log", path)
        timer.join()
    assert "restarted" in sentence
    assert json.loads(path.read_text())["ended"] == "reset"


def heard(*signals):
    """Hear signals again that a shell's background jobs, or nohup, ignore."""
    for each in signals:
        signal.signal(each, signal.SIG_DFL)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_stop_ends_dark_and_writes_the_log(tmp_path, name):
    path = tmp_path / "ring.json"
    with FakeRing() as fake:
        words = ["-m", "evsdr.ring", "run", "--port", fake.port, "--rounds", "0", "--log", str(path)]
        with subprocess.Popen(
            [sys.executable, *words],
            cwd=REPOSITORY,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: heard(signal.SIGINT, signal.SIGHUP),
        ) as host:
            wait_for(lambda: fake.rounds)
            host.send_signal(getattr(signal, name))
            try:
                _, err = host.communicate(timeout=20)
            finally:
                host.kill()
        assert host.returncode == 128 + getattr(signal, name)
        assert err.startswith("stopped; ") and "ring.json" in err
        assert not fake.lit
    assert json.loads(path.read_text())["ended"] == "stopped"


@pytest.mark.parametrize("state", ["met", "configured", "running", "ended"])
def test_a_ring_that_is_unplugged_ends_in_a_sentence(monkeypatch, state):
    settings, start = RingSettings(slot_us=1000, rounds=0 if state == "running" else 1), time.monotonic()
    with FakeRing() as fake:
        with Ring(fake.port) as host:
            if state != "met":
                host.configure(settings)
            if state in ("running", "ended"):
                host.start()
                assert host.wait(0.3 if state == "running" else 10) == (state == "ended")
            monkeypatch.setattr(
                protocol, "LOST_S", 0.2
            )  # only now, as an answer may take longer on a busy machine
            fake.open = False
            fake.thread.join()
            os.close(fake.master)
            fake.master = os.open(os.devnull, os.O_RDONLY)
            if state == "running":
                assert host.wait(5) and host.log.ended == "lost"
            for call in (host.status, lambda: host.configure(settings)):
                with pytest.raises(InputError, match="the ring is lost, .*check cable and supply"):
                    call()
    assert time.monotonic() - start < 10


def test_a_flicker_keeps_what_is_slow_enough():
    asked = RingSettings((-1, 4, 5), 500_000.0, 0.5, 30)
    assert flickering(asked) == RingSettings((4, -1, -1), 500_000.0, 1.0, 30, constant_light=True)
    assert flickering(RingSettings(rounds=0)).rounds == 0
    assert blinking(asked) == RingSettings((4, -1), 100_000.0, 0.0, 0)
