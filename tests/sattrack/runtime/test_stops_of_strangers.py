"""Stops from outside: programs of ours and a mount by others, over real UDP, its true axes as judges."""

from __future__ import annotations

import json
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from guardian import Feeder, gone, is_guardian
from programs import PATIENCE_S, SITE, ended, free_port, satellite, sattrack
from strangers import planner

from sattrack.cli import stop as stop_module
from sattrack.cli.main import run
from sattrack.runtime.mounts import owner_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

BOUND_DEG_S = 360.0 / 86164.0905 / 2.0
SIDEREAL_DEG_S = 2.0 * BOUND_DEG_S
FAST_DEG_S = 0.5
DELAY_S = 8.0
LIES = {"rate_fields": "lying", "abort_delay_s": DELAY_S, "slewing_field": "quiet"}
CUT_S = 20.0


@pytest.fixture(autouse=True)
def alone(radio_dish: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Find no sessions but those of the test."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(stop_module, "owners", list)


class Stranger:
    """One such mount in a program of its own, behind a relay that can be cut."""

    def __init__(self, process: subprocess.Popen[str], ours: int) -> None:
        assert process.stdout is not None
        self._process, self._ours = process, ours
        self._mount_port = int(json.loads(process.stdout.readline())["port"])
        self._relay = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._relay.bind(("127.0.0.1", 0))
        self.name = f"127.0.0.1:{self._relay.getsockname()[1]}"
        self.url = f"xerxes://{self.name}?listen={ours}"
        self.cut = False
        self.truths: list[dict[str, float]] = []
        self._changed = threading.Condition()
        self._threads = [threading.Thread(target=work) for work in (self._read, self._carry)]
        for thread in self._threads:
            thread.start()

    @property
    def relay_port(self) -> int:
        return int(self._relay.getsockname()[1])

    def speed_deg_s(self) -> float:
        truth = self.truths[-1]
        ra = truth["hour_angle_rate_deg_s"]
        return max(min(abs(ra), abs(ra - SIDEREAL_DEG_S)), abs(truth["dec_rate_deg_s"]))

    def wait_until(self, fast: bool, within_s: float = PATIENCE_S) -> None:
        with self._changed:
            there = self._changed.wait_for(
                lambda: bool(self.truths) and (self.speed_deg_s() > FAST_DEG_S) is fast, within_s
            )
        assert there, self.truths[-1:]

    def wait_until_moved_by(self, feeder: Feeder) -> None:
        """Wait until the mount is fast; what a feeder that ended before that said is the failure's text."""
        with self._changed:
            self._changed.wait_for(
                lambda: feeder.process.poll() is not None or self.speed_deg_s() > FAST_DEG_S, PATIENCE_S
            )
        assert self.speed_deg_s() > FAST_DEG_S, feeder.end()

    def wait_s(self, seconds: float) -> None:
        """Let the mount go on for so long."""
        until_s = time.time() + seconds
        with self._changed:
            assert self._changed.wait_for(lambda: self.truths[-1]["utc_s"] > until_s, seconds + PATIENCE_S)

    def end(self) -> None:
        self._process.terminate()
        for thread in self._threads:
            thread.join()
        self._relay.close()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            with self._changed:
                self.truths.append(json.loads(line))
                self._changed.notify_all()

    def _carry(self) -> None:
        """Carry datagrams between our end and the mount."""
        while self._process.poll() is None:
            if not select.select([self._relay], [], [], 0.1)[0]:
                continue
            try:
                data, (_, sender) = self._relay.recvfrom(400)
            except OSError:
                continue
            if not self.cut:
                self._relay.sendto(
                    data, ("127.0.0.1", self._ours if sender == self._mount_port else self._mount_port)
                )


@contextmanager
def stranger(**parameters: Any) -> Iterator[Stranger]:
    """Run a mount by others until the end."""
    ours, place = (
        free_port(),
        {"latitude_deg": 52.0, "longitude_deg": 4.5, "hour_angle_deg": -20.0, "dec_deg": 30.0},
    )
    program = [sys.executable, str(planner.__file__), "--listen", "0", "--truth"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        command = [*program, "--parameters", json.dumps(place | parameters)]
        with ended(subprocess.Popen(command, **pipes)) as process:
            mount = Stranger(process, ours)
            try:
                mount.wait_until(fast=False)
                yield mount
            finally:
                mount.end()


def move(mount: Stranger) -> Feeder:
    return Feeder(
        *("mount", "move", "--ra-rate", "-1.4", "--dec-rate", "0.1", "--seconds", "60"),
        *("--mount", mount.url, *SITE),
    )


def killed_with_its_guardian(mount: Stranger) -> None:
    """Leave the mount moving with nobody to stop it."""
    feeder = move(mount)
    try:
        mount.wait_until_moved_by(feeder)
        guardian = feeder.guardian()
        feeder.process.send_signal(signal.SIGSTOP)
        subprocess.run(["kill", "-9", str(guardian)], check=True)
    finally:
        feeder.end()


@pytest.mark.parametrize("verb", [("stop",), ("mount", "abort")])
def test_a_mount_that_lies_is_not_at_rest_before_it_is(verb: tuple[str, ...]) -> None:
    with stranger(**LIES) as mount:
        killed_with_its_guardian(mount)
        assert mount.speed_deg_s() > FAST_DEG_S
        asked_s = time.time()
        with ended(sattrack(*verb, "--mount", mount.url)) as process:
            out, err = process.communicate(timeout=PATIENCE_S)
        assert mount.speed_deg_s() < BOUND_DEG_S
        assert process.returncode == 0, err
        assert time.time() - asked_s > DELAY_S - 1.0
        assert "at rest" in out or "complete" in out


def test_a_pass_with_a_mount_that_lies_ends_when_it_is_at_rest(tmp_path: Path) -> None:
    elements, site = satellite(tmp_path, 15.0)
    latitude, longitude, _ = map(float, site.split(","))
    with stranger(**LIES | {"latitude_deg": latitude, "longitude_deg": longitude}) as mount:
        arguments = ("track", "25544", "--mount", mount.url, "--site", site, "--elements", str(elements))
        with ended(sattrack(*arguments, "--headless")) as process:
            mount.wait_until(fast=True)
            mount.wait_s(3.0)
            mount.wait_until(fast=True)
            asked_s = time.time()
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=PATIENCE_S)
        assert mount.speed_deg_s() < BOUND_DEG_S
        assert time.time() - asked_s > DELAY_S - 1.0
        assert "the mount is stopped" in err


def test_a_link_cut_for_longer_than_a_session_waits_leaves_a_guardian_that_stops_the_mount(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with stranger() as mount:
        feeder = move(mount)
        try:
            mount.wait_until_moved_by(feeder)
            guardian = feeder.guardian()
            mount.cut, cut_s = True, time.time()
            feeder.process.wait(CUT_S)
            ended_s = time.time()
            assert is_guardian(guardian)
            owner = owner_of(mount.name)
            assert owner is not None
            assert owner.goes_on is not None
            assert owner.goes_on.pid == guardian

            assert run(["mount", "slew", "5h", "10", "--mount", mount.url, *SITE]) == 1
            refused = capsys.readouterr().err
            assert refused.count("\n") == 1
            assert "is not known at rest: `sattrack mount move" in refused
            assert f"process {guardian}, still sends it stops, since" in refused
            assert "`sattrack stop --give-up` ends that" in refused

            mount.wait_s(max(0.0, cut_s + CUT_S - time.time()))
            assert mount.speed_deg_s() > FAST_DEG_S
            mount.cut = False
            back_s = time.time()
            mount.wait_until(fast=False, within_s=3.0)
            assert gone(guardian)
            assert time.time() - back_s < 5.0
            assert mount.speed_deg_s() < BOUND_DEG_S
        finally:
            said = feeder.end()
    assert feeder.process.returncode == 4
    assert ended_s - cut_s < CUT_S
    assert "still sends stops to the mount, which is NOT KNOWN AT REST" in said
    assert "seen at rest after" in (tmp_path / "sattrack" / "guardian.log").read_text()


def test_a_stop_tells_that_it_goes_on_and_may_be_given_up(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with stranger() as mount:
        feeder = move(mount)
        try:
            mount.wait_until_moved_by(feeder)
            guardian = feeder.guardian()
            mount.cut = True
            feeder.process.kill()
            # The guardian may find a status that the feeder has not read: then the mount was heard.
            assert run(["stop", "--mount", mount.url, "--json"]) in {1, 4}
            (stopped,) = json.loads(capsys.readouterr().out)["stopped"]
            assert not stopped["at_rest"]
            assert stopped["goes_on"]["pid"] == guardian
            assert "hear" in stopped["goes_on"]["heard"]
            assert "still sends it stops, since" in stopped["words"]
            assert is_guardian(guardian)
            assert run(["stop", "--mount", mount.url, "--give-up"]) == 0
            assert f"process {guardian} gave up" in capsys.readouterr().out
            assert gone(guardian)
            assert mount.speed_deg_s() > FAST_DEG_S
            assert run(["stop", "--mount", mount.url, "--give-up"]) == 2
        finally:
            feeder.end()
