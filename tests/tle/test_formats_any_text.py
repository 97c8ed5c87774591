"""No text makes a reader raise anything but its refusals, lose a set, or take more than linear time."""

from __future__ import annotations

import gc
import time

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_omm import BOMB, CSV, KVN, SPACE_TRACK, XML, as_json
from tle_facts import ISS, TDRS3

from tle.elements import Elements
from tle.errors import ElementsError, SourceError
from tle.formats import omm_notations, tle
from tle.sources import load_elements, parse_elements

READERS = {
    "tle": tle.read_tle,
    "gpredict": tle.read_gpredict,
    "csv": omm_notations.read_csv,
    "json": omm_notations.read_json,
    "xml": omm_notations.read_xml,
    "kvn": omm_notations.read_kvn,
}
GPREDICT = f"[25544]\nVERSION=1.1\nNAME=ISS\nTLE1={ISS[0]}\nTLE2={ISS[1]}\n"
WHOLE = ["\n".join(ISS), CSV, as_json(SPACE_TRACK, SPACE_TRACK), XML, KVN, GPREDICT, BOMB]


@st.composite
def damaged(draw: st.DrawFn) -> str:
    """Return one or two good texts with pieces changed, cut out or put in."""
    text = "\n".join(draw(st.lists(st.sampled_from(WHOLE), min_size=1, max_size=2)))
    for _ in range(draw(st.integers(0, 4))):
        at, cut = draw(st.integers(0, len(text))), draw(st.integers(0, 30))
        text = (
            text[:at]
            + draw(st.text(max_size=3) | st.sampled_from(['"', "{", "]", "<", "\n", "="]))
            + text[at + cut :]
        )
    return text


@given(damaged() | st.text())
@example("\x00")
@example("\ud800")
@example("<omm>\ud800</omm>")
@example('[{"BSTAR":"\\ud800"}]')
@example("[" * 100_000)
@example('{"a":' * 100_000)
@example('[{"a":1e400}]')
@example('[{"NORAD_CAT_ID":true,"EPOCH":[]}]')
@settings(max_examples=300)
def test_no_text_raises(text):
    for read in (parse_elements, *READERS.values()):
        for item in read(text, "x"):
            assert isinstance(item, Elements | ElementsError)
            if isinstance(item, ElementsError):
                assert item.reason
                assert str(item).count("\n") <= 2


@given(st.binary(max_size=300))
@example(b"\x1f\x8b\x08\x00")
@example(b"\xff\xfe[\x00{\x00")
@example(BOMB.encode("utf-16"))
def test_no_bytes_of_a_file_raise(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "file"
    path.write_bytes(data)
    try:
        sets = load_elements(path)
    except SourceError:
        return
    assert sets.accepted or sets.rejected


@given(st.lists(st.sampled_from([ISS, TDRS3]), max_size=6), st.data())
def test_sets_of_a_text_add_up(sets, data):
    """Every element line is in an accepted set, or told of in a refusal."""
    lines = [line for lines in sets for line in lines]
    dropped = data.draw(st.sets(st.integers(0, max(len(lines) - 1, 0)), max_size=3))
    kept = [line for n, line in enumerate(lines) if n not in dropped]
    found = parse_elements("\n".join(["", *kept]), "x") if kept else []
    accepted = sum(isinstance(item, Elements) for item in found)
    assert 2 * accepted + sum(1 for item in found if isinstance(item, ElementsError)) <= len(kept)
    assert 2 * (accepted + sum(isinstance(item, ElementsError) for item in found)) >= len(kept)


PIECES = [
    "1 ",
    "[",
    "{",
    '{"',
    '{"a":',
    '{\\"',
    "[{}],",
    "<a>",
    "<omm>",
    "&a;",
    "\n",
    " ",
    '",',
    "A=\n",
    "[1]\n",
    "9",
    "CCSDS_OMM_VERS = 3.0\n",
    "OBJECT_NAME = A\n",
    ISS[0] + "\n",
    '{"MEAN_MOTION":"x"},\n',
    "NORAD_CAT_ID,EPOCH\n",
    "7,\n",
]


@pytest.mark.parametrize("piece", PIECES)
@pytest.mark.parametrize("head", ["", "[", "<omm>", "TLE1=[1]\n", "NORAD_CAT_ID,EPOCH\n", "MEAN_MOTION=\n"])
def test_time_grows_no_faster_than_the_text(head, piece):
    def fastest_s(size: int, rounds: int) -> float:
        text = head + piece * (size // len(piece))
        taken = []
        # The collector's own work grows with everything else that this process holds.
        gc.disable()
        try:
            for _ in range(rounds):
                start = time.process_time()
                parse_elements(text, "x")
                taken.append(time.process_time() - start)
        finally:
            gc.enable()
        return min(taken)

    # Eight times the text: linear takes eight times as long, quadratic sixty-four times. Only what looks too
    # long is timed again.
    for rounds in (1, 5):
        large_s = fastest_s(32_000, rounds)
        if large_s < max(24.0 * fastest_s(4_000, rounds), 0.0125):
            return
    pytest.fail(f"{large_s:.2f} s for 32,000 characters")
