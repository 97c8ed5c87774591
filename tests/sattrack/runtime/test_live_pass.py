"""Real time, real sockets, other processes: what happens to the mount when things end or go wrong."""

from __future__ import annotations

import json
import select
import signal
import socket
from itertools import islice
from typing import TYPE_CHECKING

import pytest
from flight_runs import site_on_the_path, track_arguments, until
from programs import ended, free_port, sattrack, simulated_mount

from sattrack.cli.demo import demo_request
from sattrack.cli.main import run as command
from sattrack.core.errors import SattrackError
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.runtime.facts import prepare
from sattrack.runtime.flight import fly_live
from sattrack.runtime.system import StopRequest

if TYPE_CHECKING:
    import subprocess
    from pathlib import Path

    from sattrack.views.run import TrackView


pytestmark = pytest.mark.usefixtures("radio_dish")
HIGH_UTC = "2026-10-02T13:04:20Z"
"""When the satellite of the demonstration is well up, and near where its mount stands at first."""
ON_TIME_MS = 60.0
"""Where one period in a hundred is longer, the machine was too busy for the loop to keep the satellite."""


def result(process: subprocess.Popen[str]) -> tuple[int, dict[str, object], str]:
    """Let a run end; return its exit code, its summary and what it said on standard error."""
    out, err = process.communicate(timeout=60.0)
    return process.returncode, json.loads(out.splitlines()[-1])["summary"], err


def assert_at_rest(truth: dict[str, float]) -> None:
    """An axis at rest leaves the right ascension to the sky's own motion; sidereal tracking holds it."""
    assert -0.01 < truth["ra_rate_deg_s"] < SIDEREAL_RATE_DEG_S + 0.01
    assert abs(truth["dec_rate_deg_s"]) < 0.01


def test_the_demonstration_follows_the_pass() -> None:
    with ended(sattrack("demo", "--headless", "--json")) as demo:
        assert demo.stderr is not None
        # It says so at once, and then every five seconds.
        progress = (line for line in demo.stderr if "tracking" in line)
        assert len(list(islice(progress, 3))) == 3
        demo.send_signal(signal.SIGINT)
        code, summary, err = result(demo)
    assert code == 130, err
    assert err.splitlines()[-1] == "sattrack: interrupted; the mount is stopped"
    assert summary["name"] == "ISS (ZARYA)"
    assert summary["mount_stopped"] is True
    assert summary["datagrams"]["lost"] == 0
    if summary["period_ms"]["p99"] < ON_TIME_MS:
        assert summary["true_rms_arcsec"] <= 1.0
        assert summary["reported_rms_arcsec"] <= 1.0
        assert summary["on_target_s"] > 5.0
        assert summary["period_ms"]["p50"] == pytest.approx(50.0, abs=1.0)


def test_an_impatient_operator_is_told_of_the_stop_all_the_same() -> None:
    """Signals that come on and on, also while all is closed after the stop."""
    with ended(sattrack("demo", "--headless", "--json")) as demo:
        assert demo.stderr is not None
        assert demo.stdout is not None
        assert "waiting" in demo.stderr.readline()
        while not select.select([demo.stdout], [], [], 0.1)[0]:
            demo.send_signal(signal.SIGINT)
        _, summary, err = result(demo)
    assert summary["mount_stopped"] is True
    assert err.endswith("sattrack: interrupted; the mount is stopped\n")


def test_a_mount_that_falls_silent_is_told_to_stop_all_the_same(tmp_path: Path) -> None:
    site = site_on_the_path()
    with simulated_mount("--faults", "silent:20", site=site) as mount:
        arguments = track_arguments(tmp_path, site, mount.port, "--headless", "--stream")
        with ended(sattrack(*arguments)) as run:
            mount.wait_until_faster(0.3)
            code, summary, err = result(run)
        truth = mount.last_truth()
    assert code == 4
    assert summary["ended_by"] == "link"
    assert summary["mount_stopped"] is False
    assert "fell silent" in err.splitlines()[-1]
    assert "stop it by hand" in err.splitlines()[-1]
    assert "Traceback" not in err
    assert_at_rest(truth)
    # A guardian goes on with a mount that nobody has seen at rest, until somebody gives up.
    url = arguments[arguments.index("--mount") + 1]
    assert command(["stop", "--mount", url, "--give-up"]) == 0


def test_a_mount_that_does_not_answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = track_arguments(tmp_path, site_on_the_path(), free_port(), "--headless", "--json")
    assert command(arguments) == 4
    out, err = capsys.readouterr()
    summary = json.loads(out.splitlines()[-1])["summary"]
    assert summary["ended_by"] == "link"
    assert summary["mount_stopped"] is None
    listen = arguments[arguments.index("--mount") + 1].rpartition("=")[2]
    assert "no status from xerxes://127.0.0.1:" in err.splitlines()[-1]
    assert f"sends to this machine's address, port {listen}" in err.splitlines()[-1]


def test_a_port_in_use_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        arguments = track_arguments(tmp_path, site_on_the_path(), free_port(), "--headless", "--json")
        arguments[3] = f"xerxes://127.0.0.1:{free_port()}?listen={port}"
        for given in (arguments, ["sim", "--port", str(port)]):
            assert command(given) == 1
            out, err = capsys.readouterr()
            assert out == ""
            assert f"UDP port {port}" in err.splitlines()[-1]


def test_the_end_of_the_control_channel_stops_the_mount() -> None:
    with ended(sattrack("demo", "--stream", "--control", "--clock", HIGH_UTC)) as demo:
        assert demo.stdin is not None
        until(demo, "tracking")
        demo.stdin.write('{"type":"nudge","along_s":0.1}\n{"type":"nonsense"}\n')
        demo.stdin.flush()
        for line in demo.stdout or ():
            if json.loads(line)["bias_along_goal_s"] == 0.1:
                break
        code, summary, err = result(demo)
    assert code == 0
    assert summary["ended_by"] == "operator"
    assert summary["bias_along_s"] == 0.1
    assert summary["mount_stopped"] is True
    assert "a control line was ignored" in err


def test_datagrams_from_strangers_and_garbage_change_nothing(tmp_path: Path) -> None:
    """A stranger at another address, and garbage from the mount's own: counted, dropped, the pass goes on.

    Told to end by SIGTERM, it stops the mount before it does; by SIGINT it is in the demonstration.
    """
    site = site_on_the_path()
    with (
        simulated_mount(site=site) as mount,
        ended(
            sattrack(*(arguments := track_arguments(tmp_path, site, mount.port, "--headless", "--stream")))
        ) as run,
    ):
        listen = int(arguments[3].partition("listen=")[2])
        until(run, "tracking")
        for host in ("127.0.0.2", "127.0.0.1"):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.bind((host, 0))
                for size in (0, 1, 82, 160, 1999):
                    sender.sendto(b"x" * size, ("127.0.0.1", listen))
        view = until(run, "tracking")
        while view["link"]["rejected"] < 5:
            view = until(run, "tracking")
        assert abs(view["ra_rate_deg_s"]) + abs(view["dec_rate_deg_s"]) > 0.05
        run.send_signal(signal.SIGTERM)
        code, summary, err = result(run)
        truth = mount.last_truth()
    assert code == 130
    assert summary["ended_by"] == "operator"
    assert err.splitlines()[-1] == "sattrack: interrupted; the mount is stopped"
    assert_at_rest(truth)
    assert summary["datagrams"]["rejected"] == 10
    assert summary["period_ms"]["p99"] > ON_TIME_MS or summary["reported_rms_arcsec"] <= 1.0
    assert summary["mount_stopped"] is True


@pytest.mark.parametrize("error", [SattrackError("the screen is gone"), ZeroDivisionError("a defect")])
def test_whatever_breaks_in_the_loop_the_mount_is_stopped_first(error: Exception) -> None:
    prepared = prepare(demo_request(HIGH_UTC, None))
    phases: list[str] = []

    def show(view: TrackView) -> None:
        phases.append(view.phase)
        if view.phase == "tracking":
            raise error

    if isinstance(error, SattrackError):
        summary = fly_live(prepared, show, StopRequest())
        assert summary.ended_by == "error"
        assert summary.message == "the screen is gone"
        assert summary.mount_stopped is True
    else:
        with pytest.raises(ZeroDivisionError):
            fly_live(prepared, show, StopRequest())
    assert phases.count("tracking") == 1


def test_a_reader_that_goes_away_ends_the_run_with_the_mount_stopped() -> None:
    with ended(sattrack("demo", "--stream", "--seconds", "14", "--clock", HIGH_UTC)) as demo:
        until(demo, "tracking")
        assert demo.stdout is not None
        demo.stdout.close()
        assert demo.stderr is not None
        err = demo.stderr.read()
        assert demo.wait(timeout=30.0) == 1
    assert "Traceback" not in err


def test_a_front_end_that_is_killed_leaves_the_mount_stopped(tmp_path: Path) -> None:
    """Both of its pipes break at once; the run cannot say anything to anybody any more."""
    site = site_on_the_path()
    with simulated_mount(site=site) as mount:
        arguments = track_arguments(tmp_path, site, mount.port, "--headless", "--stream", "--control")
        with ended(sattrack(*arguments)) as run:
            until(run, "tracking")
            for pipe in (run.stdin, run.stdout, run.stderr):
                assert pipe is not None
                pipe.close()
            assert run.wait(timeout=30.0) in {0, 1}
        truth = mount.last_truth()
    assert_at_rest(truth)
