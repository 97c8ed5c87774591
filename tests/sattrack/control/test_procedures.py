"""What is asked for by hand, step by step, of a console and tickets made up here."""

from __future__ import annotations

import math
from types import SimpleNamespace as Made
from typing import Any

import numpy as np
import pytest

from sattrack.control.following import RateFit
from sattrack.control.manual_operation import Look, acknowledged
from sattrack.control.procedures import (
    GoHome,
    MoveFor,
    Once,
    Outcome,
    ParkThere,
    RequestRefused,
    SlewThere,
    off_axes_deg,
    procedure_for,
    request_text,
)
from sattrack.mount.model import AxesPosition, AxisLimits, MountProfile, Slew, Status, StatusSample
from sattrack.mount.requests import (
    Abort,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    Ticket,
    TicketState,
    TrackingRate,
)

COMPLETE, FAILED, TIMED_OUT = TicketState.COMPLETE, TicketState.FAILED, TicketState.TIMED_OUT
NO = RequestRefused("the Sun is there", by_safety=True)
GOAL = Slew(100.0, 20.0)
LEG = Slew(50.0, 60.0)
PARK = AxesPosition(-30.0, 20.0)
HOME = AxesPosition(10.0, 40.0)
UNTOLD = "the protocol has no acknowledgement for it; the mount "


def at_axes(hour_angle_deg: float, dec_deg: float) -> StatusSample:
    return StatusSample(0, 0.0, 8.0, (120.0 - hour_angle_deg) % 360.0, dec_deg, False, False, 0.0, 0.0)


class Desk:
    """A console that grants what it is asked, but for what it was told to refuse."""

    def __init__(self, *way: Slew) -> None:
        self.tickets: list[Ticket] = []
        self.refusals: list[RequestRefused | None] = []
        self.way: Any = way
        self.aimed: Any = None
        self.status: Any = Status()
        self.sample: Any = at_axes(0.0, 20.0)
        self.at_rest = self.stands = True
        self.move_begun = False

    def submit(self, request: Request, now_utc_s: float) -> Ticket | RequestRefused:
        refusal = self.refusals.pop(0) if self.refusals else None
        if refusal is not None:
            return refusal
        self.tickets.append(Ticket(request))
        return self.tickets[-1]

    def path_to(self, request: Slew, now_utc_s: float) -> Any:
        return self.way

    def aim(self, request: Slew, place: AxesPosition | None, now_utc_s: float) -> Any:
        self.place = place
        return request if self.aimed is None else self.aimed

    def synced(self, request: Sync, now_utc_s: float) -> Sync:
        return Sync(request.ra_deg + 1.0, request.dec_deg)

    def keep_here(self, now_utc_s: float) -> None:
        return None

    @property
    def asked(self) -> list[Request]:
        return [one.request for one in self.tickets]

    def settle(self, state: TicketState, acknowledged: bool = True, reason: str | None = None) -> None:
        ticket = self.tickets[-1]
        ticket.become(TicketState.RAISED)
        if acknowledged:
            ticket.become(TicketState.ACKNOWLEDGED)
        ticket.become(state, reason)


def test_one_request_goes_until_its_ticket_settles() -> None:
    desk, once = Desk(), Once(Sync(10.0, 20.0), "syncing")
    assert once.step(desk, 0.0) is None
    assert once.begin(desk, 0.0) is None
    # What is synced is what the mount is to report for a telescope that looks there.
    assert desk.asked == [Sync(11.0, 20.0)]
    assert once.step(desk, 1.0) is None
    desk.settle(FAILED, True, "elsewhere")
    assert once.step(desk, 2.0) == Outcome(FAILED, True, "elsewhere")
    refusing = Desk()
    refusing.refusals = [NO]
    assert Once(Abort(), "stopping").begin(refusing, 0.0) == NO


class TestSlew:
    def test_legs_are_asked_for_one_after_the_other(self) -> None:
        desk, slew = Desk(LEG, GOAL), SlewThere(GOAL, place=PARK)
        assert slew.begin(desk, 0.0) is None
        assert (desk.asked, slew.doing, desk.place) == ([LEG], "slewing round what is in the way", PARK)
        assert slew.step(desk, 1.0) is None
        desk.settle(COMPLETE)
        assert slew.step(desk, 2.0) is None
        assert (desk.asked, slew.doing) == ([LEG, GOAL], "slewing")
        desk.settle(COMPLETE)
        assert slew.step(desk, 3.0) == Outcome(COMPLETE, True)

    def test_a_leg_that_fails_ends_it(self) -> None:
        desk, slew = Desk(LEG, GOAL), SlewThere(GOAL)
        slew.begin(desk, 0.0)
        desk.settle(TIMED_OUT, False, "late")
        assert slew.step(desk, 1.0) == Outcome(TIMED_OUT, False, "late")
        assert desk.asked == [LEG]

    def test_a_leg_that_is_refused_has_the_way_sought_anew(self) -> None:
        desk, slew = Desk(LEG, GOAL), SlewThere(GOAL)
        slew.begin(desk, 0.0)
        desk.settle(COMPLETE)
        other = Slew(60.0, 70.0)
        desk.refusals, desk.way = [NO], (other, GOAL)
        assert slew.step(desk, 1.0) is None
        assert (desk.asked, slew.doing) == ([LEG, other], "slewing round what is in the way")
        desk.settle(COMPLETE)
        desk.refusals = [NO, NO]
        assert slew.step(desk, 2.0) == Outcome(FAILED, False, NO.words, NO)

    def test_no_way_at_all_is_a_refusal(self) -> None:
        for name in ("way", "aimed"):
            desk = Desk(GOAL)
            setattr(desk, name, NO)
            assert SlewThere(GOAL).begin(desk, 0.0) == NO
        desk = Desk(GOAL)
        desk.refusals = [NO]
        assert SlewThere(GOAL).begin(desk, 0.0) == NO
        later = Desk(LEG, GOAL)
        slew = SlewThere(GOAL)
        slew.begin(later, 0.0)
        later.settle(COMPLETE)
        later.refusals, later.way = [NO], NO
        assert slew.step(later, 1.0) == Outcome(FAILED, False, NO.words, NO)

    def test_one_that_rates_lead_ends_when_they_have(self) -> None:
        desk, slew = Desk(), SlewThere(GOAL)
        lead = Made(arrived=False, overdue=lambda now_utc_s: now_utc_s > 240.0)
        desk.aimed = lead
        assert slew.begin(desk, 0.0) is None
        assert slew.step(desk, 1.0) is None
        late = slew.step(desk, 241.0)
        assert late is not None
        assert (late.state, late.reason is None) == (TIMED_OUT, False)
        lead.arrived = True
        assert slew.step(desk, 2.0) == Outcome(COMPLETE, False)
        assert desk.asked == []


class TestMove:
    def test_its_seconds_count_from_the_first_datagram(self) -> None:
        desk, move = Desk(), MoveFor(MoveAxis(1.0, None), 2.0)
        desk.stands = False
        assert move.begin(desk, 100.0) is None
        assert move.step(desk, 105.0) is None
        desk.move_begun = True
        assert move.step(desk, 106.0) is None
        desk.settle(COMPLETE)
        assert move.step(desk, 107.99) is None
        assert (desk.asked, move.doing) == ([MoveAxis(1.0, None)], "moving")
        assert move.step(desk, 108.0) is None
        assert (desk.asked[1:], move.doing) == ([EndMove()], "ending the move")
        assert move.step(desk, 108.1) is None
        desk.settle(COMPLETE, False)
        assert move.step(desk, 109.0) == Outcome(COMPLETE, True)

    def test_one_that_never_begins_is_ended_after_ten_seconds(self) -> None:
        desk, move = Desk(), MoveFor(MoveAxis(1.0, None), 2.0)
        move.begin(desk, 100.0)
        assert move.step(desk, 110.0) is None
        assert len(desk.asked) == 1
        move.step(desk, 110.1)
        assert desk.asked[-1] == EndMove()
        desk.settle(COMPLETE, False)
        ended = move.step(desk, 111.0)
        assert ended == Outcome(
            TicketState.UNCONFIRMED, False, "the move was over before the mount acknowledged it"
        )

    def test_one_that_fails_or_whose_end_is_refused_says_so(self) -> None:
        desk, move = Desk(), MoveFor(MoveAxis(1.0, None), 2.0)
        move.begin(desk, 0.0)
        desk.settle(TicketState.SUPERSEDED, False, "stopped")
        assert move.step(desk, 1.0) == Outcome(TicketState.SUPERSEDED, False, "stopped")
        refusing, other = Desk(), MoveFor(MoveAxis(1.0, None), 2.0)
        other.begin(refusing, 0.0)
        refusing.move_begun = True
        other.step(refusing, 0.5)
        refusing.settle(COMPLETE)
        refusing.refusals = [NO]
        assert other.step(refusing, 3.0) == Outcome(FAILED, True, NO.words, NO)
        third = Desk()
        third.refusals = [NO]
        assert MoveFor(MoveAxis(1.0, None), 2.0).begin(third, 0.0) == NO


class TestHome:
    def home(self, place: AxesPosition | None = HOME) -> tuple[Desk, GoHome]:
        desk, home = Desk(), GoHome(place, 240.0)
        assert home.begin(desk, 100.0) is None
        assert desk.asked == [FindHome()]
        return desk, home

    def test_a_mount_that_says_that_it_is_home_is(self) -> None:
        desk, home = self.home()
        desk.settle(TicketState.UNCONFIRMED, False)
        desk.status = Status(slewing=True)
        assert home.step(desk, 101.0) is None
        desk.status = Status(at_home=True)
        assert home.step(desk, 102.0) == Outcome(COMPLETE, False)

    @pytest.mark.parametrize(
        ("place", "stands", "moved", "words"),
        [
            (HOME, (10.0, 40.09), True, "stands at the profile's home"),
            (HOME, (10.0, 40.11), True, "stands 0.1° from the profile's home"),
            (HOME, (11.5, 40.0), True, "stands 1.5° from the profile's home"),
            (None, (10.0, 40.0), True, "moved, and stands"),
            (None, (10.0, 40.0), False, "was not seen to move"),
        ],
    )
    def test_else_where_it_stands_is_told(
        self, place: AxesPosition | None, stands: tuple[float, float], moved: bool, words: str
    ) -> None:
        desk, home = self.home(place)
        desk.settle(TicketState.UNCONFIRMED, False)
        desk.status = Status(slewing=moved)
        assert home.step(desk, 101.0) is None
        desk.status, desk.sample = Status(), at_axes(*stands)
        if not moved:
            assert home.step(desk, 102.9) is None
        assert home.step(desk, 103.0) == Outcome(TicketState.UNCONFIRMED, False, UNTOLD + words)

    def test_one_that_goes_on_for_longer_than_it_may_is_given_up(self) -> None:
        desk, home = self.home()
        desk.settle(TicketState.UNCONFIRMED, False)
        desk.at_rest = False
        assert home.step(desk, 340.0) is None
        assert home.step(desk, 340.1) == Outcome(TIMED_OUT, False, "the mount did not finish its way home")
        for state in (FAILED, TIMED_OUT, TicketState.SUPERSEDED):
            failed, other = self.home()
            # Still on its way, as when somebody has stopped it.
            failed.status, failed.at_rest = Status(slewing=True), False
            failed.settle(state, False, "restarted")
            assert other.step(failed, 101.0) == Outcome(state, False, "restarted")
        unplaced, fourth = self.home()
        unplaced.settle(TicketState.UNCONFIRMED, False)
        unplaced.sample = None
        where = Outcome(TicketState.UNCONFIRMED, False, UNTOLD + "was not seen to move")
        assert fourth.step(unplaced, 103.0) == where
        waits, third = self.home()
        waits.status = None
        assert third.step(waits, 110.0) is None

    def test_where_the_whole_way_is_not_clear_slews_lead_nearer_first(self) -> None:
        desk, home = Desk(LEG, GOAL), GoHome(HOME, 240.0)
        desk.refusals = [NO]
        assert home.begin(desk, 100.0) is None
        assert desk.asked == [LEG]
        assert home.step(desk, 101.0) is None
        desk.settle(COMPLETE)
        assert home.step(desk, 102.0) is None
        assert desk.asked[-1] == GOAL
        desk.settle(COMPLETE)
        assert home.step(desk, 103.0) is None
        assert desk.asked[-1] == FindHome()
        desk.status = Status(at_home=True)
        desk.settle(TicketState.UNCONFIRMED, False)
        assert home.step(desk, 110.0) == Outcome(COMPLETE, False)

    def test_where_nothing_leads_nearer_home_is_refused(self) -> None:
        straight, busy, nowhere, refuses = Desk(GOAL), Desk(LEG, GOAL), Desk(), Desk(LEG, GOAL)
        busy.status, nowhere.way = Status(slewing=True), NO
        for desk, refusals in ((straight, [NO]), (busy, [NO]), (nowhere, [NO]), (refuses, [NO, NO])):
            desk.refusals = list(refusals)
            assert GoHome(HOME, 240.0).begin(desk, 100.0) == NO
            assert desk.asked == []
        silent = Desk(LEG, GOAL)
        silent.refusals = [RequestRefused("the mount is silent")]
        assert GoHome(HOME, 240.0).begin(silent, 100.0) == RequestRefused("the mount is silent")
        ends = Desk(LEG, GOAL)
        ends.refusals, home = [NO], GoHome(HOME, 240.0)
        assert home.begin(ends, 100.0) is None
        ends.settle(FAILED, True, "elsewhere")
        assert home.step(ends, 101.0) == Outcome(FAILED, True, "elsewhere")


class TestPark:
    PROFILE = MountProfile(
        park=PARK,
        ra=AxisLimits(slew_rate_deg_s=4.0),
        dec=AxisLimits(slew_rate_deg_s=2.0),
    )

    def test_it_slews_stops_rests_and_cuts_the_power(self) -> None:
        desk, park = Desk(), ParkThere(self.PROFILE)
        desk.way = (GOAL,)
        assert park.begin(desk, 0.0) is None
        assert desk.place == PARK
        assert park.step(desk, 1.0) is None
        desk.settle(COMPLETE)
        assert park.step(desk, 2.0) is None
        assert (desk.asked[-1], park.doing) == (Abort(), "stopping at the park position")
        assert park.step(desk, 3.0) is None
        desk.stands = False
        desk.settle(COMPLETE)
        for now_s in (4.0, 9.0):
            assert park.step(desk, now_s) is None
            assert desk.asked[-1] == Abort()
        assert park.step(desk, 9.1) is None
        assert (desk.asked[-1], park.doing) == (Park(), "parking")
        desk.settle(TicketState.UNCONFIRMED, False, "no acknowledgement")
        assert park.step(desk, 10.0) == Outcome(TicketState.UNCONFIRMED, False, "no acknowledgement")

    def test_without_a_cut_it_ends_with_the_stop(self) -> None:
        desk, park = Desk(), ParkThere(self.PROFILE, power_off=False)
        desk.way = (GOAL,)
        park.begin(desk, 0.0)
        desk.settle(COMPLETE)
        park.step(desk, 1.0)
        desk.settle(COMPLETE)
        assert park.step(desk, 2.0) == Outcome(COMPLETE, True)
        assert Park() not in desk.asked

    def test_a_step_that_fails_ends_it(self) -> None:
        desk, park = Desk(), ParkThere(self.PROFILE)
        desk.way = (GOAL,)
        park.begin(desk, 0.0)
        desk.settle(FAILED, True, "elsewhere")
        assert park.step(desk, 1.0) == Outcome(FAILED, True, "elsewhere")
        stop, other = Desk(), ParkThere(self.PROFILE)
        stop.way = (GOAL,)
        other.begin(stop, 0.0)
        stop.settle(COMPLETE)
        other.step(stop, 1.0)
        stop.settle(TIMED_OUT, False, "deaf")
        assert other.step(stop, 2.0) == Outcome(TIMED_OUT, False, "deaf")
        assert Park() not in stop.asked

    def test_its_slew_ends_where_the_axes_park_sidereal_tracking_counted(self) -> None:
        """30° at the slower axis' 2°/s and two seconds more: the sky turns by 17 s of 15″ meanwhile."""
        desk, park = Desk(), ParkThere(self.PROFILE)
        aimed: list[Slew] = []
        desk.aim = lambda request, place, now: aimed.append(request) or NO  # type: ignore[method-assign, func-returns-value, assignment]
        assert park.begin(desk, 0.0) == NO
        # Sidereal time 120°, and an hour angle of -30°.
        assert aimed == [Slew(pytest.approx(150.0 + 17.0 * 15.0 / 3600.0), 20.0)]

    def test_a_stop_or_a_cut_that_safety_forbids_ends_it_and_says_why(self) -> None:
        for refused_after in (0, 1):
            desk, park = Desk(), ParkThere(self.PROFILE)
            desk.way = (GOAL,)
            park.begin(desk, 0.0)
            desk.settle(COMPLETE)
            if refused_after:
                assert park.step(desk, 1.0) is None
                desk.settle(COMPLETE)
            desk.refusals = [NO]
            assert park.step(desk, 2.0) == Outcome(FAILED, False, NO.words, NO)
            assert Park() not in desk.asked

    def test_without_a_place_or_a_status_it_is_refused(self) -> None:
        refusal = ParkThere(MountProfile()).begin(Desk(), 0.0)
        assert refusal is not None
        assert "no park position" in refusal.words
        unheard = Desk()
        unheard.sample = None
        refusal = ParkThere(self.PROFILE).begin(unheard, 0.0)
        assert refusal == RequestRefused("the mount has not been heard yet")


@pytest.mark.parametrize(
    ("stands", "off_deg"),
    [((-30.0, 20.0), 0.0), ((-31.5, 20.5), 1.5), ((-30.5, 23.0), 3.0), ((170.0, 20.0), 160.0)],
)
def test_the_distance_of_axes_is_that_of_the_one_farther_off(
    stands: tuple[float, float], off_deg: float
) -> None:
    assert off_axes_deg(at_axes(*stands), PARK) == pytest.approx(off_deg)


def test_each_request_has_its_procedure_and_its_words() -> None:
    profile = MountProfile(park=PARK, home=HOME)
    assert isinstance(procedure_for(Park(), profile), ParkThere)
    home = procedure_for(FindHome(), profile)
    assert isinstance(home, GoHome)
    assert home.within_s == 240.0
    slow = MountProfile(ra=AxisLimits(slew_rate_deg_s=0.5))
    assert GoHome(None, slow.goes_within_s()).within_s == 1080.0
    # Rates lead no faster than they may be.
    led = MountProfile(dec=AxisLimits(max_rate_deg_s=0.25))
    assert (led.goes_within_s(), led.goes_within_s(by_rates=True)) == (240.0, 2160.0)
    assert home.home == HOME
    assert isinstance(procedure_for(GOAL, profile), SlewThere)
    with pytest.raises(ValueError, match="a MoveAxis needs its length"):
        procedure_for(MoveAxis(1.0, None), profile)
    doing = {
        type(one).__name__: procedure_for(one, profile).doing
        for one in (Sync(0.0, 0.0), Abort(), PulseGuide(1, 0), FineRate(), TrackingRate(0), EndMove())
    }
    assert doing == {
        "Sync": "syncing",
        "Abort": "stopping",
        "PulseGuide": "guiding",
        "FineRate": "setting the fine rates",
        "TrackingRate": "setting the tracking rate",
        "EndMove": "ending the move",
    }


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (MoveAxis(1.5, -0.5), "move RA +1.5 °/s Dec -0.5 °/s"),
        (MoveAxis(None, -0.5), "move Dec -0.5 °/s"),
        (PulseGuide(100, -20), "pulse RA +100 ms Dec -20 ms"),
        (FineRate(0.001, -0.002), "fine rate RA +0.001 °/s Dec -0.002 °/s"),
        (TrackingRate(2), "tracking rate 2"),
        (Abort(), "abort"),
        (Park(), "park"),
        (FindHome(), "home"),
        (EndMove(), "end the move"),
    ],
)
def test_a_request_in_words(request_: Request, words: str) -> None:
    assert request_text(request_) == words


def test_a_direction_in_words() -> None:
    assert request_text(Slew(75.0, 0.0)).startswith("slew to RA ")
    assert request_text(Sync(75.0, 0.0)).startswith("sync to RA ")
    # 75° are 5 h.
    assert request_text(Slew(75.0, 0.0)).split()[3].startswith(("5", "05"))
    assert request_text(Sync(75.0, -12.5)) == "sync to RA 05h 00m 00.0s Dec −12° 30′ 00″"


def test_what_is_no_status_acknowledges_nothing() -> None:
    assert acknowledged(b"") == set()


class Console:
    profile = MountProfile()

    def __init__(self) -> None:
        self.sample: Any = None

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        self.sample = data or None

    def tick(self, now_utc_s: float) -> bytes:
        return b"knock"


class TestLook:
    def test_it_ends_a_second_after_the_first_status(self) -> None:
        console: Any = Console()
        look = Look(console, 100.0, 5.0, knock=False)
        look.receive(b"", 100.5)
        assert (look.tick(101.0), look.finished) == (None, False)
        look.receive(b"status", 102.0)
        look.receive(b"status", 102.5)
        assert (look.tick(102.99), look.finished) == (None, False)
        assert (look.tick(103.0), look.finished, look.mount_stopped) == (None, True, None)

    def test_in_silence_it_knocks_after_half_a_second_and_ends_in_time(self) -> None:
        for knock, sent in ((True, b"knock"), (False, None)):
            console: Any = Console()
            look = Look(console, 100.0, 5.0, knock)
            assert look.tick(100.49) is None
            assert look.tick(100.5) == sent
            look.tick(104.99)
            assert look.finished is False
            look.tick(105.0)
            assert look.finished is True

    def test_it_can_be_ended(self) -> None:
        for end in (lambda look: look.interrupt(0.0), lambda look: look.fail("broken", 0.0)):
            console: Any = Console()
            look = Look(console, 100.0, 5.0, knock=False)
            end(look)
            assert look.finished is True


class TestRateFit:
    def fit(self, gain: float, rest: float, noise: float, count: int = 400) -> tuple[RateFit, Any, Any]:
        dice = np.random.default_rng(7)
        asked = dice.uniform(-1.0, 2.0, count)
        seen = gain * asked + rest + dice.normal(0.0, noise, count)
        fit = RateFit()
        for one, other in zip(asked.tolist(), seen.tolist(), strict=True):
            fit.take(one, other)
        return fit, asked, seen

    def test_a_free_line_is_the_least_squares_line(self) -> None:
        fit, asked, seen = self.fit(1.05, 0.01, 0.002)
        line = fit.line(1e6)
        assert line is not None
        slope, rest = np.polyfit(asked, seen, 1)
        assert (line.gain, line.rest_deg_s) == pytest.approx((slope, rest))
        # Residuals of forty samples in a row count as one.
        left = seen - slope * asked - rest
        variance = 40.0 * float(left @ left) / len(asked)
        inverse = np.linalg.inv(np.array([[asked @ asked, asked.sum()], [asked.sum(), float(len(asked))]]))
        assert line.gain_sigma == pytest.approx(math.sqrt(variance * inverse[0, 0]), rel=1e-6)
        assert line.rest_sigma_deg_s == pytest.approx(math.sqrt(variance * inverse[1, 1]), rel=1e-6)

    def test_no_gain_is_known_better_than_by_half_an_arcsecond_a_second_of_noise(self) -> None:
        fit, asked, _ = self.fit(1.05, 0.01, 0.0)
        line = fit.line(1e6)
        assert line is not None
        inverse = np.linalg.inv(np.array([[asked @ asked, asked.sum()], [asked.sum(), float(len(asked))]]))
        noise = math.sqrt(40.0) * 0.5 / 3600.0
        assert line.gain_sigma == pytest.approx(noise * math.sqrt(inverse[0, 0]), rel=1e-6)
        assert line.rest_sigma_deg_s == pytest.approx(noise * math.sqrt(inverse[1, 1]), rel=1e-6)

    def test_a_presumed_rest_is_the_prior_of_a_normal_one(self) -> None:
        """The rest is normal about 0: a further row of weight variance·40/sigma² in the normal equations."""
        fit, asked, seen = self.fit(1.0, 0.01, 0.02)
        line = fit.line()
        assert line is not None
        prior = 3.0 / 3600.0
        gain, rest = np.polyfit(asked, seen, 1)
        for _ in range(60):
            left = seen - gain * asked - rest
            weight = float(left @ left) / len(asked) * 40.0 / prior**2
            normal = np.array([[asked @ asked, asked.sum()], [asked.sum(), len(asked) + weight]])
            gain, rest = np.linalg.solve(normal, np.array([asked @ seen, seen.sum()]))
        assert line.gain == pytest.approx(gain, rel=1e-4)
        assert line.rest_deg_s == pytest.approx(rest, rel=2e-2)

    def test_too_few_or_too_slow_samples_tell_nothing(self) -> None:
        few, _, _ = self.fit(1.0, 0.0, 0.0, 99)
        assert (few.line(), few.ratio) == (None, None)
        enough, asked, seen = self.fit(1.1, 0.0, 0.0, 100)
        assert enough.line() is not None
        assert enough.ratio == pytest.approx(1.1)
        assert enough.fastest_asked_deg_s == pytest.approx(np.abs(asked).max())
        assert enough.fastest_deg_s == pytest.approx(np.abs(seen).max())
        for rate, tells in ((0.0099, False), (0.0101, True)):
            slow = RateFit()
            for _ in range(100):
                slow.take(rate, 2.0 * rate)
            assert (slow.ratio is not None) is tells
        still = RateFit()
        for _ in range(200):
            still.take(0.0, 0.1)
        assert still.line() is None
