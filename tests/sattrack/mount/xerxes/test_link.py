"""What the client counts of a link, by hand: intervals, losses, restarts, acknowledgements of another's."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace
from xerxes_builders import PERIOD_S, T0, TRACKING

from sattrack.mount.xerxes.datagrams import Command
from sattrack.mount.xerxes.link import COUNTS, AckWatch, LinkHealth, LinkState, StatusSequence

PLAIN = Command()
PULSING = Command(pulse_guide=True)
PULSED = replace(TRACKING, ack_pulse_guide=True)


class TestHealth:
    def test_rate_and_jitter_are_those_of_the_intervals(self) -> None:
        """50, 60 and 40 ms: 20 Hz on the mean, and a standard deviation of 10 ms."""
        health = LinkHealth()
        assert (health.rate_hz, health.jitter_s, health.age_s(T0)) == (None, None, None)
        health.hear(0.0, 1)
        assert (health.rate_hz, health.jitter_s) == (None, None)
        health.hear(0.05, 1)
        assert health.rate_hz == pytest.approx(20.0)
        assert health.jitter_s is None
        health.hear(0.11, 1)
        assert health.jitter_s == pytest.approx(0.005 * math.sqrt(2.0))
        health.hear(0.15, 1)
        assert health.rate_hz == pytest.approx(20.0)
        assert health.jitter_s == pytest.approx(0.01)
        view = health.view(LinkState.UP, 0.25, 3.0, -0.125)
        assert (view.state, view.age_s, view.delay_ms, view.clock_offset_s) == ("up", 0.25, 3.0, -0.125)
        assert view.rate_hz == pytest.approx(20.0)
        assert view.jitter_ms == pytest.approx(10.0)
        assert health.age_s(0.25) == pytest.approx(0.1)

    def test_before_anything_was_heard_nothing_is_told(self) -> None:
        view = LinkHealth(**{name: number for number, name in enumerate(COUNTS)}).view(LinkState.SILENT, None)
        assert (view.age_s, view.rate_hz, view.jitter_ms) == (None, None, None)
        assert [getattr(view, name) for name in COUNTS] == list(range(len(COUNTS)))

    def test_an_age_is_never_negative(self) -> None:
        assert LinkHealth().view(LinkState.UP, -0.01).age_s == 0.0

    @pytest.mark.parametrize(
        ("interval_s", "old_s"), [(0.05, 0.3), (0.1, 0.3), (0.2, 0.4), (0.5, 1.0), (0.9, 1.8), (1.5, 2.0)]
    )
    def test_a_status_is_old_after_two_of_the_usual_intervals(self, interval_s: float, old_s: float) -> None:
        health = LinkHealth()
        for number in range(20):
            # One that is held up changes nothing, nor do lost ones.
            late_s = 0.7 * interval_s if number == 17 else 0.0
            health.hear(T0 + 3 * number * interval_s + late_s, 3)
        last_s = T0 + 57 * interval_s
        assert health.look(last_s + old_s - 0.01) is LinkState.UP
        assert health.look(last_s + old_s + 0.01) is (LinkState.STALE if old_s < 2.0 else LinkState.LOST)
        assert health.look(last_s + 2.01) is LinkState.LOST

    def test_lost_statuses_were_sent_all_the_same(self) -> None:
        health = LinkHealth()
        for number in (0, 1, 4, 6):
            health.hear(number * PERIOD_S, 3 if number == 4 else 2 if number == 6 else 1)
        assert health.rate_hz == pytest.approx(1.0 / PERIOD_S)
        assert health.jitter_s == pytest.approx(0.0, abs=1e-12)

    def test_a_clock_that_goes_back_and_a_count_that_does_make_no_interval(self) -> None:
        health = LinkHealth()
        health.hear(10.0, 1)
        health.hear(9.0, 1)
        assert health.rate_hz is None
        health.hear(9.0, 1)
        assert health.rate_hz is None
        health.hear(9.05, -5)
        assert health.rate_hz == pytest.approx(20.0)

    def test_the_last_hundred_intervals_count(self) -> None:
        health = LinkHealth()
        for number in range(50):
            health.hear(number * 1.0, 1)
        for number in range(101):
            health.hear(100.0 + number * 0.1, 1)
        assert health.rate_hz == pytest.approx(10.0)

    def test_what_a_mount_did_before_it_was_lost(self) -> None:
        health = LinkHealth()
        assert health.did == "fell silent"
        health.freeze()
        health.freeze()
        assert (health.frozen, health.froze) == (2, True)
        assert health.did == "said the same again and again while it moved"
        health.hear(0.0, 1)
        assert (health.frozen, health.did) == (2, "fell silent")


class Sequence:
    def __init__(self, *counters: int) -> None:
        self.health = LinkHealth()
        self.judge = StatusSequence(self.health)
        self.now = T0
        self.take(*counters)

    def take(self, *counters: int, after_s: float = PERIOD_S) -> list[bool]:
        taken = []
        for counter in counters:
            self.now += after_s
            taken.append(self.judge.is_news(counter, self.now))
        return taken

    @property
    def counts(self) -> dict[str, int]:
        names = ("lost", "late", "duplicate", "rejected", "restarts")
        return {name: getattr(self.health, name) for name in names if getattr(self.health, name)}


class TestSequence:
    @pytest.mark.parametrize(
        ("silence_s", "ahead", "taken"),
        [
            # 20 s of statuses, and 40 a second of silence.
            (0.0, 400, True),
            (0.0, 401, False),
            (10.0, 800, True),
            (10.0, 801, False),
            (-5.0, 400, True),
            (-5.0, 401, False),
        ],
    )
    def test_how_far_a_counter_may_run_ahead(self, silence_s: float, ahead: int, taken: bool) -> None:
        sequence = Sequence(1000)
        assert sequence.take(1000 + ahead, after_s=silence_s) == [taken]
        assert sequence.counts == ({"lost": ahead - 1} if taken else {"rejected": 1})

    def test_three_of_another_rising_count_are_a_restart(self) -> None:
        sequence = Sequence(5000)
        assert sequence.take(7, 11, 15) == [False, False, True]
        assert sequence.counts == {"late": 2, "restarts": 1}
        assert sequence.take(16) == [True]

    @pytest.mark.parametrize("counters", [(7, 12, 17), (7, 7, 7), (7, 6, 5), (7, 8, 5000, 9), (7, 8)])
    def test_others_are_none(self, counters: tuple[int, ...]) -> None:
        sequence = Sequence(5000)
        assert not any(sequence.take(*counters))
        assert "restarts" not in sequence.counts

    def test_what_is_accepted_begins_the_proof_anew(self) -> None:
        sequence = Sequence(5000)
        assert sequence.take(7, 8, 5001, 9, 10, 11) == [False, False, True, False, False, True]

    def test_statuses_that_come_late_are_not_lost(self) -> None:
        sequence = Sequence(1, 2, 6)
        assert sequence.counts == {"lost": 3}
        assert sequence.take(3, 4, 5) == [False] * 3
        assert sequence.counts == {"late": 3}
        assert sequence.health.overtaken_s == pytest.approx(3 * PERIOD_S)
        assert sequence.take(4) == [False]
        assert sequence.counts == {"late": 4}

    def test_what_comes_half_a_second_late_may_be_of_a_mount_that_counts_anew(self) -> None:
        late = Sequence(1, 10)
        assert late.take(3, 4, 5, after_s=0.16) == [False] * 3
        anew = Sequence(1, 10)
        anew.take(11, after_s=0.5)
        assert anew.take(3, 4, 5, after_s=0.01) == [False, False, True]
        assert anew.take(12) == [True]
        assert anew.counts["lost"] == 8 - 2 + 6

    def test_long_losses_are_counted_whole_and_remembered_in_part(self) -> None:
        sequence = Sequence(0)
        for _ in range(5):
            assert sequence.take(sequence.judge._last + 400, after_s=10.0) == [True]  # type: ignore[operator]
        assert sequence.counts == {"lost": 5 * 399}
        assert len(sequence.judge._missing) <= 800
        assert sequence.take(1999, 1601) == [False] * 2
        assert sequence.counts == {"lost": 5 * 399 - 2, "late": 2}


class Watch:
    def __init__(self) -> None:
        self.health = LinkHealth()
        self.acks = AckWatch(self.health)

    def send(self, command: Command, times: int = 1) -> None:
        for _ in range(times):
            self.acks.sent(command)

    @property
    def counts(self) -> tuple[int, int]:
        return self.health.doubled_launches, self.health.foreign_acks

    def ack(self) -> None:
        """Have an acknowledgement rise and fall."""
        self.acks.see(PULSED)
        self.acks.see(TRACKING)


class TestAcknowledgements:
    def test_one_for_a_rise_of_ours_is_ours(self) -> None:
        watch = Watch()
        watch.send(PLAIN, 100)
        watch.send(PULSING, 3)
        watch.ack()
        watch.send(PLAIN, 2)
        assert watch.counts == (0, 0)
        watch.send(PULSING, 3)
        watch.send(PLAIN)
        watch.ack()
        assert watch.counts == (0, 0)

    @pytest.mark.parametrize(("after", "counts"), [(1, (1, 0)), (40, (1, 0)), (41, (0, 1))])
    def test_a_second_one_within_two_seconds_is_a_doubled_launch(
        self, after: int, counts: tuple[int, int]
    ) -> None:
        watch = Watch()
        watch.send(PLAIN, 100)
        watch.send(PULSING, 3)
        watch.ack()
        watch.send(PLAIN, after)
        watch.ack()
        assert watch.counts == counts

    def test_before_anything_of_ours_it_is_anothers(self) -> None:
        watch = Watch()
        watch.send(PLAIN, 3)
        watch.acks.see(PULSED)
        watch.acks.see(PULSED)
        assert watch.counts == (0, 1)

    @pytest.mark.parametrize(("up", "counts"), [(11, (0, 0)), (12, (0, 1))])
    def test_a_fall_under_a_flag_that_has_long_been_up_is_anothers(
        self, up: int, counts: tuple[int, int]
    ) -> None:
        watch = Watch()
        watch.send(PULSING, up)
        watch.ack()
        assert watch.counts == counts

    def test_three_within_ten_seconds_are_an_intruder(self) -> None:
        watch = Watch()
        for after in (100, 100, 100):
            assert watch.acks.intruder is None
            watch.send(PLAIN, after)
            watch.ack()
        assert watch.counts == (0, 3)
        assert watch.acks.intruder is not None
        assert watch.acks.intruder.startswith("another program is sending commands to this mount")
        watch.send(PLAIN)
        assert watch.acks.intruder is None

    def test_a_restarted_mount_has_acknowledged_nothing(self) -> None:
        watch = Watch()
        watch.send(PLAIN, 100)
        watch.acks.see(PULSED)
        watch.acks.forget()
        watch.acks.see(PULSED)
        assert watch.counts == (0, 2)
