"""The page of a preview: for this machine and who knows the token only, and what a browser makes of it."""

import http.client
import json
import socket
import threading
import time
from urllib.parse import urlsplit

import numpy as np
import pytest

websockets = pytest.importorskip("websockets")
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from evsdr.viewing.moment import moment
from evsdr.viewing.server import Newest, Server, text_of
from evsdr.viewing.sums import Sums
from tests.support.grown_files import as_camera, ball
from tests.support.watched_files import N_LED, SIZE


@pytest.fixture
def server():
    with Server("run <b>") as server:
        yield server


def ball_now(end=np.inf, ended=False):
    sums = Sums(ball().schedule, SIZE, SIZE)
    sums.add(as_camera(ball(), end=end))
    return text_of(moment(sums, ended=ended))


def asked(server, path, host=None):
    """Ask for a path; gives status, headers, text."""
    place = urlsplit(server.address).netloc
    connection = http.client.HTTPConnection(place, timeout=10)
    connection.request("GET", path, headers={"Host": host or place})
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, answer.headers, text


def test_only_who_knows_the_token_gets_the_page(server):
    path = urlsplit(server.address).path
    status, headers, text = asked(server, path)
    assert (
        status == 200
        and "<title>run &lt;b&gt; – evsdr preview" in text
        and "connect-src ws://127.0.0.1" in text
    )
    assert headers["Cache-Control"] == "no-store" and headers["Referrer-Policy"] == "no-referrer"
    for wrong in ("/", "/wrong/", path[:-2] + "/", path.rstrip("/")[:-1] + "é/".encode().decode("latin-1")):
        assert asked(server, wrong.encode().decode("ascii", "ignore"))[0] == 403
    assert asked(server, path, host="evil.example")[0] == 403  # a name that was made to point here
    assert asked(server, path + "other")[0] == 404
    assert not server.opened.is_set()


def test_only_the_page_itself_gets_the_feed(server):
    here = urlsplit(server.address)
    feed = f"ws://{here.netloc}{here.path}feed"
    origin = f"http://{here.netloc}"
    for address, whence in (
        (feed.replace(here.path, "/wrong/"), origin),
        (feed, "http://evil.example"),
        (feed, "null"),
        (feed, None),
    ):
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, origin=whence)
    assert not server.opened.is_set()
    server.newest.put("1")
    with connect(feed, origin=origin) as page:
        assert page.recv(timeout=10) == "1" and server.opened.is_set()
        server.newest.put("2", ended=True)
        assert page.recv(timeout=10) == "2"
        with pytest.raises(ConnectionClosed):
            page.recv(timeout=10)


def test_who_is_late_gets_the_last(monkeypatch):
    after = Newest.after

    def late(self, number):
        text, number, ended = after(self, number)
        time.sleep(0.3 if ended else 0)
        return text, number, ended

    monkeypatch.setattr(Newest, "after", late)
    with Server("a") as server:
        here = urlsplit(server.address)
        page = connect(f"ws://{here.netloc}{here.path}feed", origin=f"http://{here.netloc}")
        assert server.opened.wait(10)
        server.newest.put("last", ended=True)
    with page:
        assert list(page) == ["last"]


def test_it_listens_on_this_machine_only(server):
    port = urlsplit(server.address).port
    with socket.socket() as other:  # all of 127/8 is this machine, but only .1 is listened on
        assert other.connect_ex(("127.0.0.2", port)) != 0


def test_who_is_slow_misses_what_was_between():
    newest, got = Newest(), []
    for k in range(5):
        newest.put(str(k))
    got.append(newest.after(0)[:2])
    waiting = threading.Thread(target=lambda: got.append(newest.after(5)))
    waiting.start()
    newest.put("last", ended=True)
    waiting.join(10)
    assert got == [("4", 5), ("last", 6, True)]


def test_a_browser_shows_it(server, browser, tmp_path):
    """Pictures of each LED, nothing on the console, and no request but to the page's own address."""
    server.newest.put(ball_now(end=50_000))
    browser.messages.clear()
    browser.open(server.address.rstrip("/"), "document.documentElement?.dataset.ready === 'yes'")
    assert browser.evaluate("document.getElementById('state').textContent") == "waiting"
    server.newest.put(ball_now())
    browser.await_true("document.querySelectorAll('#leds canvas').length > 0")
    assert browser.evaluate("document.getElementById('state').textContent") == "locked"
    grey = "[...document.querySelectorAll('#leds canvas')].map((c) => Array.from(c.getContext('2d').getImageData(0, 0, c.width, c.height).data))"
    shown = np.array(browser.evaluate(grey)).reshape(N_LED, SIZE, SIZE, 4)
    level = shown[..., 0][shown[..., 3] == 255]
    assert 0.4 < (shown[..., 3] == 255).mean() < 0.9 and level.min() < 20 and level.max() > 240
    assert browser.evaluate("document.querySelectorAll('#rate polygon').length") == 2
    assert browser.evaluate("document.querySelectorAll('#triggers circle').length") == 5
    browser.screenshot(tmp_path / "preview.png", whole=True)
    server.newest.put(ball_now(ended=True), ended=True)
    browser.await_true("document.getElementById('link').textContent.includes('has ended')")
    assert browser.evaluate("document.getElementById('trouble').hidden")
    assert browser.messages == [f"request {server.address.rstrip('/')}"]


def test_a_browser_that_does_not_know_the_token_is_refused(server, browser):
    browser.messages.clear()
    browser.open(server.address.rsplit("/", 2)[0] + "/wrong/", "document.readyState === 'complete'")
    assert "not the one that evsdr.capture has printed" in browser.evaluate("document.body.textContent")


def test_what_is_shown_is_plain_json():
    assert json.loads(ball_now())["n_round"] == 4
    with pytest.raises(ValueError):
        text_of({"a": float("nan")})
