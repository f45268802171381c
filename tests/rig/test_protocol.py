"""Lines of the protocol: checksums, answers."""

import pytest

from evsdr.rig.protocol import LONGEST_LINE, Lines, RingRefused, frame, parse, unframe


def test_checksum_is_that_of_the_standard():
    assert frame("123456789") == b"123456789*29B1\n"  # the check value of CRC-16/CCITT-FALSE
    assert unframe(b"123456789*29B1") == "123456789"
    assert unframe(b"123456780*29B1") is None and unframe(b"*") is None and unframe(b"") is None


def test_answers_are_words_and_values():
    answer = parse("OK armed rounds=6 slot=20000")
    assert (answer.words, answer.values) == (("armed",), {"rounds": "6", "slot": "20000"})
    assert answer.number("rounds") == 6
    for name in ("slots", "armed"):
        with pytest.raises(RingRefused, match=f"lacks a number {name}"):
            answer.number(name)


def test_an_error_is_raised_with_its_words():
    with pytest.raises(RingRefused, match="^7 order has 65 slots$"):
        parse("ERR 7 order has 65 slots")
    with pytest.raises(RingRefused, match="lacks a number rounds"):
        parse("OK rounds=-1").number("rounds")


def test_a_line_may_come_in_pieces_and_a_spoiled_one_is_left_out():
    whole, spoiled = frame("1 OK"), frame("2 OK").replace(b"2", b"3", 1)
    lines = Lines()
    pieces = whole[:4], whole[4:] + spoiled + whole, b"x" * 1000, b"\n" + whole
    assert [lines.take(piece) for piece in pieces] == [[], ["1 OK", "1 OK"], [], ["1 OK"]]
    assert len(lines._rest) <= LONGEST_LINE
