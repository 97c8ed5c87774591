"""The Field System's side: the line's rules without a line, and the trajectories that are sent."""

from __future__ import annotations

import math
from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

import antenna as bench
import pytest
from antenna_setup import NOON_NS, exchange, make_controller

from sattrack.servers.antenna.antcn import (
    Antcn,
    AntcnPhase,
    AntcnRun,
    LineState,
    chord,
    epoch_utc_s,
    read_position,
)
from sattrack.servers.antenna.controller import Controller
from sattrack.servers.antenna.protocol import NS, Checksum, character_time_out_s, encode, idle_time_s

if TYPE_CHECKING:
    from collections.abc import Callable

NOON_S = NOON_NS / NS
CHARACTER_S = 0.003


def idle_line() -> Antcn:
    line = Antcn(CHARACTER_S)
    line.synchronise(0.0)
    line.tick(1.0)
    return line


def test_a_line_begins_with_the_synchronisation_character_and_silence() -> None:
    line = Antcn(CHARACTER_S)
    assert line.synchronise(10.0) == b"#"
    line.tick(10.005)
    assert line.stage is LineState.SYNCHRONISING
    # What still comes is thrown away, and the silence begins anew.
    assert line.receive(b"PS 1 2 3", 10.0055) is None
    line.tick(10.0075)
    assert line.stage is LineState.SYNCHRONISING
    line.tick(10.0116)
    assert line.stage is LineState.IDLE


def test_one_transaction_is_under_way_at_a_time() -> None:
    line = idle_line()
    assert line.send("PS", 2.0) == b"PS C3\n"
    with pytest.raises(RuntimeError, match="a response"):
        line.send("PS", 2.1)
    answer = line.receive(b"TD ACK A7\n", 2.2)
    assert answer is not None
    assert (answer.sent, answer.response, answer.first_character_utc_s) == ("PS", "TD ACK", 2.2)
    assert line.stage is LineState.IDLE


def test_a_time_out_synchronises_anew() -> None:
    line = idle_line()
    line.send("PS", 2.0)
    assert line.tick(2.4) == (b"", None)
    out, answer = line.tick(2.5)
    assert out == b"#"
    assert answer is not None
    assert answer.response is None
    assert line.stage is LineState.SYNCHRONISING
    assert line.time_outs == 1


def test_a_garbled_response_is_no_response() -> None:
    line = idle_line()
    line.send("PS", 2.0)
    assert line.receive(b"TD ACK A8\n", 2.1) is None
    assert line.garbled == 1
    assert line.tick(2.6)[0] == b"#"


def test_character_time_outs_follow_the_speed_of_the_line() -> None:
    assert character_time_out_s(9600) == pytest.approx(0.003125)
    assert character_time_out_s(115200) == pytest.approx(0.003125 / 12)
    assert idle_time_s(0.003) == pytest.approx(0.006)


def test_a_crc_is_the_one_of_the_catalogues() -> None:
    assert Checksum.CRC16.of(b"123456789") == b"29B1"
    assert encode("PS", Checksum.CRC16) == b"PS EDDC\n"


def test_messages_hold_nothing_that_would_break_the_line() -> None:
    for message in ("TD #", "TD\n", "TD \xe9", "TD\t1"):
        with pytest.raises(ValueError, match="no message may hold"):
            encode(message)


def test_a_chord_joins_both_ends_of_its_interval() -> None:
    def way(utc_s: float) -> tuple[float, float]:
        t = utc_s - NOON_S
        return 179.9 + 0.5 * t + 0.01 * t * t, 10.0 - 0.1 * t * t

    first, second, first_rate, second_rate, epoch, wrap = chord(way, NOON_NS + 2 * NS, 1.0).split()[1:]
    assert (Decimal(epoch), wrap) == (Decimal("43202"), "S")
    assert float(first) == pytest.approx(180.94, abs=1e-9)
    assert float(first) + float(first_rate) == pytest.approx(181.49, abs=1e-9)
    assert float(second) == pytest.approx(9.6, abs=1e-9)
    assert float(second) + float(second_rate) == pytest.approx(9.1, abs=1e-9)


def test_a_chord_goes_the_short_way_through_north() -> None:
    def way(utc_s: float) -> tuple[float, float]:
        return (359.5 + (utc_s - NOON_S)) % 360.0, 0.0

    assert float(chord(way, NOON_NS, 1.0).split()[3]) == pytest.approx(1.0)


def test_seconds_of_the_day_are_of_the_nearest_day() -> None:
    midnight_s = NOON_S + 43200.0
    assert epoch_utc_s(86399.9, midnight_s + 0.1) == pytest.approx(midnight_s - 0.1)
    assert epoch_utc_s(0.1, midnight_s - 0.1) == pytest.approx(midnight_s + 0.1)


@pytest.mark.parametrize(
    "text",
    [
        "PS",
        "PS 1 2",
        "XX " + "1 " * 13,
        "PS a b c d e f g h 0 0 1 REMOTE IDLE",
        "PS 1 2 inf 4 0 0 0 0 0 0 1 REMOTE IDLE",
        "PS 1 2 3 4 0 0 nan 0 0 0 1 REMOTE IDLE",
        "PS 1 2 3 4 0 0 0 0 0 0 nan REMOTE IDLE",
    ],
)
def test_what_is_no_position_status_is_told(text: str) -> None:
    with pytest.raises(ValueError, match=r"position status|could not convert|is no number"):
        read_position(text)


def make_run(line: Antcn) -> AntcnRun:
    return AntcnRun(line, lambda _: (30.0, 40.0), NOON_S, NOON_S + 10.0, 15.0, NOON_S - 1.0)


def drive(
    run: AntcnRun, until_s: float, answer_from_s: float = 0.0, answer_to_s: float = math.inf
) -> list[str]:
    """Let a run talk to a controller that answers at once, between two instants; return what it said."""
    controller = make_controller()
    now_s, said = NOON_S - 1.0, []
    run.begin(now_s)
    while not run.finished and now_s < NOON_S + until_s:
        sent = run.tick(now_s)
        if len(sent) > 1:
            said.append(sent.decode().rsplit(" ", 1)[0])
            answer = exchange(controller, sent, now_s - NOON_S)
            if answer_from_s <= now_s - NOON_S < answer_to_s:
                run.receive(answer, now_s + 0.001)
        now_s += 0.005
    return said


def test_a_pass_is_a_ps_and_a_td_a_second_and_a_stop_at_its_end() -> None:
    run = make_run(Antcn(CHARACTER_S))
    said = drive(run, 30.0, -10.0)
    words = [message.split()[0] for message in said]
    assert run.finished
    assert run.ended_by == "set"
    assert run.mount_stopped
    assert abs(words.count("TD") - 11) <= 1
    assert abs(words.count("PS") - 11) <= 2
    assert words.count("STOP") == 1
    assert run.error_arcsec == 0.0
    assert run.phase is AntcnPhase.STOPPING


def test_a_controller_that_never_answers_is_given_up() -> None:
    run = make_run(Antcn(CHARACTER_S))
    drive(run, 60.0, math.inf)
    assert run.finished
    assert run.ended_by == "link"


def test_a_controller_that_falls_silent_is_told_to_stop_until_given_up() -> None:
    run = make_run(Antcn(CHARACTER_S))
    said = drive(run, 60.0, -10.0, 3.0)
    assert run.ended_by == "link"
    assert run.mount_stopped is False
    assert said[-1] == "STOP"
    assert said.count("STOP") > 10


PLACE = "PS ,, ,, {first:.6f} 40 ,, ,, {rate} 0 ,, 0 {epoch:.6f} REMOTE {servo}"


def converse(run: AntcnRun, until_s: float, answer: Callable[[str, float], str]) -> None:
    """Let a run talk to a controller written out by hand, which answers each word at an instant."""
    now_s = NOON_S - 1.0
    run.begin(now_s)
    while not run.finished and now_s < NOON_S + until_s:
        sent = run.tick(now_s)
        if len(sent) > 1:
            run.receive(encode(answer(sent.decode().split()[0], now_s - NOON_S)), now_s + 0.001)
        now_s += 0.005


def answered_with(run: AntcnRun, until_s: float, position: Callable[[float], str]) -> list[str]:
    """Let a run talk to a controller that acknowledges whatever it is told; return what it said."""
    said = []

    def answer(word: str, seconds: float) -> str:
        said.append(word)
        return position(seconds) if word == "PS" else f"{word} ACK"

    converse(run, until_s, answer)
    return said


@pytest.mark.parametrize("answer", ["STOP NAK 1", "?? NAK 1", "STOP NAK", "TD ACK"])
def test_a_stop_that_is_not_acknowledged_is_sent_again(answer: str) -> None:
    """A line is garbled on its way, or a response to an earlier command comes late: the antenna goes on."""
    run, words = make_run(Antcn(CHARACTER_S)), []

    def controller(sent: str, seconds: float) -> str:
        words.append(sent)
        if sent == "STOP":
            return answer if words.count("STOP") < 4 else "STOP ACK"
        rests = words.count("STOP") >= 4
        first, servo = (30.0, "IDLE") if rests else (30.0 + 0.1 * seconds, "TRACKING")
        return PLACE.format(first=first, rate=0 if rests else 0.1, epoch=43200.0 + seconds, servo=servo)

    converse(run, 60.0, controller)
    assert words.count("STOP") == 4
    assert (run.ended_by, run.mount_stopped) == ("set", True)


def test_a_controller_that_refuses_a_stop_is_asked_where_the_antenna_is() -> None:
    """An antenna in local is its operator's to stop, and may be at rest."""
    run, words = make_run(Antcn(CHARACTER_S)), []

    def controller(sent: str, seconds: float) -> str:
        words.append(sent)
        if sent == "STOP":
            return "STOP NAK 8"
        return PLACE.format(first=30.0, rate=0, epoch=43200.0 + seconds, servo="IDLE")

    converse(run, 60.0, controller)
    assert run.finished
    assert run.mount_stopped is True
    assert words.count("STOP") < 5


def test_a_controller_that_tells_the_same_again_and_again_is_given_up() -> None:
    run = make_run(Antcn(CHARACTER_S))
    frozen = PLACE.format(first=30.0, rate=0, epoch=43200.0, servo="TRACKING")
    said = answered_with(run, 6.0, lambda _: frozen)
    assert run.ended_by == "link"
    assert "the same position again and again" in (run.message or "")
    assert "STOP" in said


def told_but_between(begin_s: float, end_s: float) -> Callable[[float], str]:
    """Return a controller whose mount is silent for a while."""

    def place(seconds: float) -> str:
        told = PLACE.format(first=30.0, rate=0, epoch=43200.0 + seconds, servo="TRACKING")
        untold = begin_s < seconds < end_s
        return told.replace("30.000000 40 ,, ,, 0 0 ,, 0", ",, ,, ,, ,, ,, ,, ,, ,,") if untold else told

    return place


def test_an_antenna_whose_position_is_not_told_is_not_said_to_be_tracking() -> None:
    run = make_run(Antcn(CHARACTER_S))
    answered_with(run, 2.9, told_but_between(1.0, 3.0))
    assert (run.phase, run.error_arcsec) == (AntcnPhase.ACQUIRING, None)
    assert run.ended_by is None
    run = make_run(Antcn(CHARACTER_S))
    answered_with(run, 4.9, told_but_between(1.0, 3.0))
    assert (run.phase, run.error_arcsec) == (AntcnPhase.TRACKING, 0.0)
    # The time without positions is none on the target.
    assert run.on_target_s < 2.0


def test_a_controller_that_tells_no_position_for_long_is_told_to_stop() -> None:
    run = make_run(Antcn(CHARACTER_S))
    said = answered_with(run, 7.0, told_but_between(1.0, math.inf))
    assert run.ended_by == "link"
    assert "does not tell where the antenna is" in (run.message or "")
    assert said[-1] != "TD"
    assert "STOP" in said


def test_an_antenna_that_runs_on_is_not_at_rest_whatever_rates_it_tells() -> None:
    run = make_run(Antcn(CHARACTER_S))

    def runs_on(seconds: float) -> str:
        return PLACE.format(first=30.0 + 0.1 * seconds, rate=0, epoch=43200.0 + seconds, servo="IDLE")

    answered_with(run, 90.0, runs_on)
    assert run.ended_by == "set"
    assert run.finished
    assert run.mount_stopped is False


def test_a_controller_whose_clock_jumps_is_told_to_stop() -> None:
    run = make_run(Antcn(CHARACTER_S))

    def jumps(seconds: float) -> str:
        late_s = 300.0 if seconds > 3.0 else 0.0
        return PLACE.format(first=30.0, rate=0, epoch=43200.0 + seconds - late_s, servo="TRACKING")

    answered_with(run, 6.0, jumps)
    assert run.ended_by == "error"
    assert "clock is off ours by 300 s" in (run.message or "")


def test_a_refusal_ends_the_run_and_says_why() -> None:
    run = make_run(Antcn(CHARACTER_S))
    run.begin(NOON_S)
    run.tick(NOON_S + 0.1)
    run.tick(NOON_S + 0.97)
    run.receive(encode("TD NAK 8"), NOON_S + 0.98)
    assert run.ended_by == "error"
    assert "local" in (run.message or "")


def test_a_transmission_error_does_not() -> None:
    run = make_run(Antcn(CHARACTER_S))
    run.begin(NOON_S)
    run.tick(NOON_S + 0.1)
    run.tick(NOON_S + 0.97)
    run.receive(encode("TD NAK 1"), NOON_S + 0.98)
    assert run.ended_by is None
    assert run.refused == 1


def test_the_clock_of_the_controller_is_judged_by_its_epochs() -> None:
    run = make_run(Antcn(CHARACTER_S))
    run.begin(NOON_S)
    run.tick(NOON_S + 0.1)
    run.line.send("PS", NOON_S + 0.2)
    run.receive(encode("PS ,, ,, 30 40 ,, ,, 0 0 ,, 0 43200.750000 REMOTE IDLE"), NOON_S + 0.25)
    assert run.clock_gap_s == pytest.approx(0.5, abs=1e-5)


def test_a_fast_part_of_a_pass_is_followed_as_well_as_chords_can() -> None:
    middle_s = 0.5 * (bench.RISE_UTC_S + bench.SET_UTC_S)
    figures = bench.designated(1.0, begin_utc_s=middle_s - 25.0, end_utc_s=middle_s + 25.0)
    own = bench.own_error(False, middle_s - 25.0 + bench.SETTLED_S, middle_s + 24.0)
    assert figures.rms_arcsec < 1.1 * own
    assert own < 0.45 * bench.own_error(True, middle_s - 25.0 + bench.SETTLED_S, middle_s + 24.0)
    assert figures.stopped


def test_at_ten_a_second_within_one_arcsecond() -> None:
    middle_s = 0.5 * (bench.RISE_UTC_S + bench.SET_UTC_S)
    figures = bench.designated(0.1, begin_utc_s=middle_s - 20.0, end_utc_s=middle_s + 10.0)
    assert figures.rms_arcsec < 1.0


def test_by_elements_the_controller_keeps_the_feeders_bounds() -> None:
    middle_s = 0.5 * (bench.RISE_UTC_S + bench.SET_UTC_S)
    figures = bench.by_elements(middle_s - 20.0, middle_s + 10.0)
    assert figures.rms_arcsec < 0.1
    assert figures.peak_arcsec < 0.6


def test_with_character_time_outs_a_response_that_stops_half_way_is_given_up_at_once() -> None:
    line = Antcn(CHARACTER_S, per_character=True)
    line.synchronise(0.0)
    line.tick(1.0)
    line.send("PS", 2.0)
    assert line.tick(2.3) == (b"", None)
    line.receive(b"PS ", 2.31)
    line.receive(b"1", 2.3129)
    assert line.tick(2.3155) == (b"", None)
    assert line.tick(2.316)[0] == b"#"


def test_a_controller_with_the_other_check_takes_no_sums() -> None:
    antenna = replace(make_controller().antenna, check=Checksum.CRC16)
    controller = Controller(antenna)
    assert controller.receive(b"TIME 4F\n", NOON_NS)[0].startswith(b"TIME NAK 1 ")
    answer, _ = controller.receive(encode("TIME", Checksum.CRC16), NOON_NS)
    assert answer.startswith(b"TIME 20728 43200.000000 ")
    message, check = answer[:-5], answer[-5:-1]
    assert int(check, 16) == bitwise_crc(message)


def bitwise_crc(message: bytes) -> int:
    """Return the CRC-16 of polynomial 0x1021 from 0xFFFF, a bit at a time."""
    crc = 0xFFFF
    for byte in message:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc
