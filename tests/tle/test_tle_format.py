from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tle_facts import ISS, TDRS3

from tle.elements import Elements
from tle.errors import (
    ChecksumError,
    ElementsError,
    FieldError,
    FieldRangeError,
    FormatError,
    LineLengthError,
    MismatchedLinesError,
    MissingLineError,
    SwappedLinesError,
    TleError,
)
from tle.sources import WRITTEN, parse_elements, write_elements

ONE, TWO = ISS


def summed(line: str) -> str:
    """Return a line with the checksum that its other columns ask for."""
    body = line[:68]
    return body + str(sum(int(c) if c in "0123456789" else c == "-" for c in body) % 10)


def put(line: str, first: int, text: str) -> str:
    """Return a line with text from a 1-based column on, and the checksum made right again."""
    return summed(line[: first - 1] + text + line[first - 1 + len(text) :])


@pytest.mark.parametrize(
    ("line1", "line2", "kind", "line", "columns", "words"),
    [
        (ONE[:-1] + "3", TWO, ChecksumError, 1, (69, 69), "checksum is 3 but its columns add up to 2"),
        (ONE, TWO[:-1] + "x", FieldError, 2, (69, 69), "checksum must be a digit"),
        (ONE[:50], TWO, LineLengthError, 1, (51, 69), "cut off: 50 of 69"),
        (ONE, TWO[:68], LineLengthError, 2, (69, 69), "cut off: 68 of 69"),
        (ONE + " 0.0", TWO, LineLengthError, 1, (70, 73), "continues after"),
        (TWO, ONE, SwappedLinesError, 1, (1, 1), "line 2 stands before line 1"),
        (ONE, TDRS3[1], MismatchedLinesError, 2, (3, 7), "line 2 is of object 19548, line 1 of object 25544"),
        (put(ONE, 3, "I5544"), TWO, FieldError, 1, (3, 7), "'I5544' is no number, nor an Alpha-5"),
        (put(ONE, 8, "4"), TWO, FieldError, 1, (8, 8), "classification '4' is no letter"),
        (put(ONE, 19, "2x"), TWO, FieldError, 1, (19, 20), "epoch year '2x'"),
        (put(ONE, 21, "275-01380287"), TWO, FieldError, 1, (21, 32), "no day of the year with a fraction"),
        (put(ONE, 21, "366.00000000"), TWO, FieldRangeError, 1, (21, 32), "366 is no day of the year 2026"),
        (put(ONE, 21, "000.00000000"), TWO, FieldRangeError, 1, (21, 32), "0 is no day"),
        (put(ONE, 34, " .0000o738"), TWO, FieldError, 1, (34, 43), "first derivative of mean motion"),
        (put(ONE, 45, " 0000a+0"), TWO, FieldError, 1, (45, 52), "second derivative of mean motion"),
        (put(ONE, 54, " 7674 -4"), TWO, FieldError, 1, (54, 61), "drag term B*"),
        (put(ONE, 63, "x"), TWO, FieldError, 1, (63, 63), "ephemeris type 'x'"),
        (put(ONE, 63, "4"), TWO, FieldRangeError, 1, (63, 63), "another theory than SGP4 (SGP4-XP)"),
        (put(ONE, 65, "9.99"), TWO, FieldError, 1, (65, 68), "element set number"),
        (put(ONE, 33, "1"), TWO, FieldError, 1, (33, 33), "column 33 must be blank, not '1'"),
        (ONE, put(TWO, 9, "51.63I2 "), FieldError, 2, (9, 16), "inclination '51.63I2'"),
        (
            ONE,
            put(TWO, 9, "180.0001"),
            FieldRangeError,
            2,
            (9, 16),
            "inclination 180.0001 is outside 0 to 180°",
        ),
        (ONE, put(TWO, 9, "-51.6312"), FieldRangeError, 2, (9, 16), "inclination -51.6312"),
        (ONE, put(TWO, 18, "360.0001"), FieldRangeError, 2, (18, 25), "right ascension of the node 360.0001"),
        (ONE, put(TWO, 27, "0.06946"), FieldError, 2, (27, 33), "eccentricity '0.06946' is not all digits"),
        (ONE, put(TWO, 35, "400.0000"), FieldRangeError, 2, (35, 42), "argument of perigee 400.0"),
        (ONE, put(TWO, 44, "   nan  "), FieldError, 2, (44, 51), "mean anomaly 'nan'"),
        (ONE, put(TWO, 53, " 0.00000000"), FieldRangeError, 2, (53, 63), "mean motion 0.0"),
        (ONE, put(TWO, 53, "99.00000000"), FieldRangeError, 2, (53, 63), "mean motion 99.0"),
        (ONE, put(TWO, 64, "5x831"), FieldError, 2, (64, 68), "revolution number '5x831'"),
    ],
)
def test_tells_what_is_wrong_and_marks_it(line1, line2, kind, line, columns, words):
    (error,) = parse_elements(f"ISS (ZARYA)\n{line1}\n{line2}\n", "iss.tle")
    assert type(error) is kind
    assert isinstance(error, TleError)
    assert error.exit_code == 2
    first, quoted, mark = str(error).split("\n")
    assert first.startswith(f"iss.tle:{line + 1}: ")
    assert words in first
    assert ":" in error.reason or "put" in error.reason
    assert quoted == "    " + (line1, line2)[line - 1]
    assert mark == "    " + " " * (columns[0] - 1) + "^" * (columns[1] - columns[0] + 1)
    assert error.name == "ISS (ZARYA)"
    with pytest.raises(kind):
        Elements.from_tle(line1, line2)


def test_reads_names_comments_blank_lines_and_crlf():
    text = f"\ufeff# of today\r\n\r\n0 ISS (ZARYA)\r\n{ONE}  \r\n{TWO}\r\n\r\n{TDRS3[0]}\r\n{TDRS3[1]}"
    one, two = parse_elements(text, "x")
    assert (one.name, one.catalog_number) == ("ISS (ZARYA)", 25544)
    assert (two.name, two.catalog_number) == ("", 19548)


def test_a_bad_set_does_not_hide_the_others():
    text = (
        f"A\n{ONE[:40]}\n{TWO}\nB\n{TDRS3[0]}\n{TDRS3[1]}\n{ONE}\nC\n{ONE}\n{TWO}\nstray\n{ONE}\n{TDRS3[0]}\n"
    )
    found = [type(item).__name__ for item in parse_elements(text, "x")]
    wanted = ["LineLengthError", "Elements", "MissingLineError", "Elements"]
    assert found == [*wanted, "MissingLineError", "MissingLineError"]


def test_lines_without_their_partners():
    (error,) = parse_elements(TWO, "x")
    assert isinstance(error, MissingLineError)
    assert "line 1 of this set is missing" in str(error)
    stray, _ = parse_elements(f"ISS\nNAUKA\n{ONE}\n{TWO}", "x")
    assert isinstance(stray, FormatError)
    assert "neither a satellite's name" in str(stray)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("  \n\n", "is empty"),
        ("no data", "holds no element sets"),
        ("\n <!DOCTYPE html><title>Busy</title>", "is a web page"),
        ("OBJECT_NAME,OBJECT_ID,EPOCH,MEAN_MOTION\n", "holds no element sets"),
        ("[]", "empty list"),
        ("CCSDS_TDM_VERS = 1.0\n", "observations"),
        ("Amateur Radio\n7530\n14129\n", "list of catalogue numbers"),
    ],
)
def test_other_texts_give_one_clear_error(text, words):
    (error,) = parse_elements(text, "file.txt")
    assert isinstance(error, FormatError)
    assert str(error).startswith("file.txt:")
    assert words in str(error)
    assert "\n" not in str(error)


def test_control_characters_do_not_reach_the_terminal():
    (error,) = parse_elements(f"{put(ONE, 9, chr(27))}\n{TWO}", "x")
    assert "\x1b" not in str(error)


def test_a_line_without_end_is_not_quoted_without_end():
    (error,) = parse_elements(f"{ONE}{'9' * 100_000}\n{TWO}", "x")
    assert "100069 columns" in error.reason
    assert len(str(error)) < 500


def test_fields_that_may_be_blank():
    # Of the SGP4 verification set (Vallado et al. 2006): no designator, ephemeris type, checksummed as given.
    old = Elements.from_tle(
        "1 11801U          80230.29629788  .01431103  00000-0  14311-1      13",
        "2 11801  46.7916 230.4354 7318036  47.4722  10.4117  2.28537848    13",
    )
    assert (old.designator, old.element_set_number, old.revolution_number) == ("", 1, 1)
    assert old.epoch.isoformat("seconds") == "1980-08-17T07:06:40Z"


_LINES = st.sampled_from([ONE, TWO, *TDRS3, "ISS", "0 ISS", "#", ""])


@st.composite
def damaged(draw):
    """Element text with a few characters changed, cut out or put in."""
    text = "\n".join(draw(st.lists(_LINES, max_size=8)))
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(text)))
        cut = draw(st.integers(0, 3))
        text = text[:at] + draw(st.text(max_size=3)) + text[at + cut :]
    return text


@given(damaged() | st.text())
@example("1 \n2 ")
@example("\x00")
@example(f"{put(ONE, 3, '²5544')}\n{TWO}")
@example(f"{ONE}\n{put(TWO, 9, '٥١.٦٣١٢ ')}")
def test_no_text_raises_anything_but_our_errors(text):
    for item in parse_elements(text, "x"):
        assert isinstance(item, Elements | ElementsError)
        if isinstance(item, ElementsError):
            assert item.reason


@given(st.lists(st.sampled_from("0123456789 .-+AZ"), min_size=60, max_size=75).map("".join))
def test_no_line_raises_anything_but_our_errors(body):
    with pytest.raises(ElementsError):
        Elements.from_tle("1 " + body, TWO)


@pytest.mark.parametrize("section", ["25544", "Satellite"])
def test_reads_a_list_of_gpredict_and_the_file_of_one_satellite(section):
    # `satellites.dat` has a section for each number, a file of the folder `satdata` one by the word.
    text = f"[{section}]\nVERSION=1.1\nNAME=ISS (ZARYA)\nNICKNAME=ISS\nTLE1={ONE}\nTLE2={TWO}\nSTATUS=1\n"
    assert parse_elements(text) == [Elements.from_tle(ONE, TWO, "ISS (ZARYA)")]
    assert parse_elements(text.replace("\n", "\r\n")) == parse_elements(text)
    (refused,) = parse_elements(text.replace(TWO, TWO[:-1]), "25544.sat")
    assert isinstance(refused, LineLengthError)
    assert (refused.line, refused.catalog_number, refused.name) == (6, 25544, "ISS (ZARYA)")


@pytest.mark.parametrize(("letter", "read"), [("u", "U"), (" ", "U"), ("C", "C")])
def test_a_classification_that_was_read_can_be_read_from_what_is_written(letter, read):
    (one,) = parse_elements(f"{put(ONE, 8, letter)}\n{TWO}\n")
    assert one.classification == read
    for form in WRITTEN:
        assert parse_elements(write_elements([one], form))[0].classification == read
