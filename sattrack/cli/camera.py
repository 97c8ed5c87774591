"""`sattrack camera`: find the satellite in the frames of a camera, and tell the active run."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import select
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options
from sattrack.cli.output import can_draw_lines_anew, renew, say, tell
from sattrack.core import local_time
from sattrack.core.angles import separation_deg
from sattrack.core.channel import Channel, see_off
from sattrack.core.errors import BadInputError, SattrackError, needed
from sattrack.core.process import ending_with_us, self_command

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import IO

    from sattrack.camera.centring import Centred, ImageGeometry, Solution, Solver
    from sattrack.camera.detection import Detection, Detector, ExpectedMotion
    from sattrack.camera.frames import CameraFrame
    from sattrack.camera.sources import FrameSource
    from sattrack.runtime.star_run import CameraProcess

UNNAMED = "camera"
"""What a camera is called that is given no name; the second one of a run is camera-2."""
MOST_REFUSALS_TOLD = 5
MANY_UNFOUND = 10
"""So many fields of a run are not found before a message says so: clouds and trails hide stars."""
FAR_DEG, NEAR_S = 1.5, 0.5
"""A field counts as far from the mount's direction, beyond its own width, and a view as of its instant."""
NICE = 10
END_WITHIN_S = 3.0
RUN_WITHIN_S = 20.0
TRY_AGAIN_S = 0.1


@click.command("camera")
@click.argument("source")
@click.option("--scale", type=float, metavar="ARCSEC_PER_PIXEL", help="Arcseconds in a pixel.")
@click.option(
    "--rotation", type=float, metavar="DEG", help="Position angle of the image's +y, north through east."
)
@click.option("--flip", is_flag=True, default=None, help="The image is mirrored.")
@click.option(
    "--exposure", default="auto", metavar="S", help="Seconds, or auto: by what is seen.", show_default=True
)
@click.option("--latency", default=0.0, metavar="S", help="By how much the camera dates its frames too late.")
@click.option(
    "--name", default=None, metavar="NAME", help="Its name in the settings and messages; default: camera."
)
@click.option(
    "--save", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Keep frames as FITS."
)
@click.option("--watch", is_flag=True, help="With folder: wait for new files.")
@click.option("--solve/--no-solve", default=True, help="Find the field among the stars.", show_default=True)
@click.option("--run", "pid", type=int, metavar="PID", help="The process of the run, if several are active.")
@click.option("--child", is_flag=True, hidden=True)
@click.option("--alone", is_flag=True, hidden=True, help="Print what is seen, and send it to no run.")
@common_options("json", "utc")
def command(context: CommandContext, source: str, **options: Any) -> int:
    """Find the satellite in the frames of a camera, and send where it is to the active run.

    SOURCE is folder:DIR (FITS, PNG), alpaca://HOST:PORT/N, indi://HOST:PORT/NAME or v4l:/dev/video0. Without
    a run, what is seen is only printed.

    \b
    Examples:
      sattrack camera folder:tonight --scale 2.5 --json
      sattrack camera alpaca://192.0.2.7:11111/0 --scale 2.5 --rotation 12
    """
    from sattrack.camera.detection import Detector
    from sattrack.camera.sources import SourceOptions, open_source

    needed("sep", "a camera", "camera")
    # A second thread waits, busy, for the next small fit: it takes a core and gains nothing.
    needed("threadpoolctl", "a camera", "camera").threadpool_limits(1)
    geometry = _geometry(context, options)
    _check_save(source, options["save"])
    given = SourceOptions(_exposure_s(options["exposure"]), options["latency"], options["watch"])
    if options["child"] or options["alone"]:
        os.nice(NICE)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    run = None
    if not options["alone"]:
        run = _awaited(options["pid"]) if options["child"] else _run(options["pid"])
    try:
        camera = open_source(source, given)
    except SattrackError:
        if run is not None:
            run.close()
        raise
    if run is not None and not options["child"]:
        _warn_of_unknown_rotation(options["name"] or UNNAMED, geometry)
    look = Looker(Detector(), geometry, options["name"] or UNNAMED, options["solve"], waits=run is None)
    # Over the sky a misaligned mount turns each field otherwise.
    look.lies_still = not options["alone"]
    try:
        # Files that are there are all looked at, whether or not a run ends meanwhile.
        outlives = source.startswith("folder:") and not options["watch"]
        return _watch(context, _items(camera, None if outlives else run), camera, look, run, options["save"])
    finally:
        camera.close()
        if run is not None:
            run.close()


def camera_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a run beside which a camera solves fields; `solving_camera` reads them."""
    for option in (
        click.option(
            "--latency", default=0.0, metavar="S", help="By how much the camera dates its frames too late."
        ),
        click.option("--exposure", default="1", show_default=True, metavar="S", help="Seconds."),
        click.option(
            "--scale", type=float, metavar="ARCSEC_PER_PIXEL", help="Arcseconds in a pixel of the camera."
        ),
        click.option("--camera", metavar="SOURCE", help="The camera, as for `sattrack camera`."),
    ):
        function = option(function)
    return function


def solving_camera(context: CommandContext, options: dict[str, Any]) -> CameraProcess:
    """Start the camera of a run, as the options say."""
    from sattrack.runtime.star_run import CameraProcess

    words = ["--exposure", options["exposure"], "--latency", str(options["latency"])]
    if options["scale"] is not None:
        words += ["--scale", str(options["scale"])]
    if options["camera"].startswith("folder:"):
        words.append("--watch")
    file = context.settings_file
    return CameraProcess(options["camera"], words if file is None else [*words, "--config", str(file)])


def _geometry(context: CommandContext, options: dict[str, Any]) -> ImageGeometry:
    """Return how the image lies, by the options, else the settings of the camera of that name."""
    from sattrack.camera.centring import ImageGeometry

    settings = context.settings
    named, general = settings.cameras.get(options["name"] or ""), settings.camera
    known = named is not None or not settings.cameras
    if not known and options["scale"] is None and not (options["name"] or UNNAMED).startswith(UNNAMED):
        raise BadInputError(f"--name {options['name']}: the settings have {', '.join(settings.cameras)}")

    def value(option: str, key: str) -> Any:
        if options[option] is not None:
            return options[option]
        own = None if named is None else getattr(named, key)
        return getattr(general, key) if own is None else own

    scale = value("scale", "scale_arcsec_px")
    if scale is not None and not 0.0 < scale <= 3600.0:
        raise BadInputError(f"--scale {scale:g}: give arcseconds in a pixel, above 0 to 3600")
    rotation = value("rotation", "rotation_deg")
    if rotation is not None and not abs(rotation) <= 360.0:
        raise BadInputError(f"--rotation {rotation:g}: give degrees, -360 to 360")
    return ImageGeometry(scale, rotation, value("flip", "flipped"))


def _check_save(source: str, save: Path | None) -> None:
    kind, _, place = source.partition(":")
    if save is not None and kind == "folder" and save.resolve() == Path(place).resolve():
        raise BadInputError(f"--save {save}: the frames are read there; give another folder")


def _exposure_s(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.0 < seconds <= 3600.0:
        raise BadInputError(f"--exposure {text}: give seconds, above 0 to 3600, or auto")
    return seconds


@dataclass(slots=True)
class CamerasSeen:
    """What the cameras of a run came to."""

    frames: int = 0
    detected: int = 0
    first_utc: str | None = None

    def add(self, line: dict[str, Any]) -> None:
        """Take one frame, as `camera --json` prints it."""
        self.frames += 1
        if line["kind"] != "none":
            self.detected += 1
            self.first_utc = min(self.first_utc or line["utc"], line["utc"])


def _named(text: str, number: int) -> tuple[str, str]:
    """Return name and source of `[NAME=]SOURCE`, the n-th of a run's."""
    name, equals, source = text.partition("=")
    if equals and re.fullmatch(r"[\w.-]+", name):
        return name, source
    return (UNNAMED if number == 0 else f"{UNNAMED}-{number + 1}"), text


def check_cameras(context: CommandContext, options: dict[str, Any]) -> None:
    """Raise BadInputError for what can be no camera of a run, SattrackError where an extra is missing."""
    from sattrack.camera.sources import check_source

    for number, text in enumerate(options["cameras"]):
        name, source = _named(text, number)
        try:
            check_source(source)
        except BadInputError as error:
            raise BadInputError(f"--camera {text}: {error}") from None
        _geometry_in_run(context, options, name)
        _check_save(source, options["save"])
    _exposure_s(options["exposure"] or "auto")
    for number, text in enumerate(() if options["virtual"] else options["cameras"]):
        name, _ = _named(text, number)
        _warn_of_unknown_rotation(name, _geometry_in_run(context, options, name))
    needed("sep", "a camera", "camera")


def _warn_of_unknown_rotation(name: str, geometry: ImageGeometry) -> None:
    """Report what a run assumes of an image whose rotation is not given."""
    if geometry.rotation_deg is None:
        tell(
            f"camera {name}: its rotation is not known: the run assumes that up is north, and learns better "
            "by its first correction, which goes the wrong way then; give --rotation"
        )


def _geometry_in_run(context: CommandContext, options: dict[str, Any], name: str) -> ImageGeometry:
    """Return how the image of a run's camera lies. Raises BadInputError."""
    image = {"scale": options["scale"], "rotation": options["camera_rotation"], "name": name}
    return _geometry(context, {**image, "flip": options["camera_flip"] or None})


@contextlib.contextmanager
def camera_processes(context: CommandContext, options: dict[str, Any]) -> Iterator[CamerasSeen]:
    """Start `sattrack camera` for each camera of a run that begins now, and end them with it.

    What they print is read when the run is over: nothing of them is in the loop that feeds the mount.
    """
    seen = CamerasSeen()
    with contextlib.ExitStack() as stack:
        started = []
        for number, text in enumerate(options["cameras"]):
            name, source = _named(text, number)
            lines, complaints = (stack.enter_context(tempfile.TemporaryFile()) for _ in range(2))
            command = [*self_command(), "camera", source, "--child", "--run", str(os.getpid()), "--json"]
            command += ["--name", name, *_image_options(context, options)]
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=lines,
                stderr=complaints,
                env=ending_with_us(),
                start_new_session=True,
            )
            started.append((name, process, lines, complaints))
        try:
            yield seen
        finally:
            for _, process, _, _ in started:
                process.terminate()
            for name, process, lines, complaints in started:
                see_off(process, END_WITHIN_S)
                _read_back(seen, name, lines, complaints)


def _image_options(context: CommandContext, options: dict[str, Any]) -> list[str]:
    words = ["--watch"]
    for option, value in (
        ("--scale", options["scale"]),
        ("--rotation", options["camera_rotation"]),
        ("--exposure", options["exposure"]),
        ("--save", options["save"]),
        ("--config", context.settings_file),
    ):
        if value is not None:
            words += [option, str(value)]
    return [*words, "--flip"] if options["camera_flip"] else words


def _read_back(seen: CamerasSeen, name: str, lines: IO[bytes], complaints: IO[bytes]) -> None:
    lines.seek(0)
    for line in lines:
        with contextlib.suppress(ValueError, KeyError):
            seen.add(json.loads(line))
    complaints.seek(0)
    for text in complaints.read().decode(errors="replace").splitlines()[-MOST_REFUSALS_TOLD:]:
        tell(f"{name}: {text.removeprefix('sattrack: ')}")


def put_solved_frames(
    context: CommandContext, options: dict[str, Any], put: Callable[[bytes], None]
) -> CamerasSeen:
    """Look through the folders that a run in virtual time is given; put what was solved as observations.

    Offsets are relative to where the mount was that took the frames, which is not the simulated one: frames
    without a solution are left out, and counted in a message. Raises BadInputError for a camera.
    """
    from sattrack.camera.detection import Detector
    from sattrack.camera.sources import SourceOptions, open_source
    from sattrack.views.messages import encode_message

    seen, unsolved = CamerasSeen(), 0
    for number, text in enumerate(options["cameras"]):
        name, source = _named(text, number)
        if not source.startswith("folder:"):
            raise BadInputError(f"--camera {source}: in virtual time frames come from a folder")
        geometry = _geometry_in_run(context, options, name)
        look = Looker(Detector(), geometry, name, solves=True, waits=True)
        for item in open_source(source, SourceOptions(_exposure_s(options["exposure"] or "auto"))).frames():
            if isinstance(item, SattrackError):
                tell(str(item))
                continue
            found = look.look(item, None)[0]
            seen.add(found.document(found.direction is not None))
            if found.direction is not None:
                put(encode_message(found.direction))
            else:
                unsolved += found.offset is not None
    if unsolved:
        from sattrack.views.formatting import counted

        frames = counted(unsolved, "frame was", "frames were")
        tell(f"{frames} not solved: an offset means nothing to a mount that did not take it")
    return seen


class ObservationLink:
    """The run to which observations go, through its view server; its views say how the sky moves."""

    def __init__(self, pid: int) -> None:
        """Connect. Raises SattrackError where that is no run."""
        from sattrack.tui.attached import welcomed

        self._connection, lines, welcome = welcomed(pid, "camera", shows=True)
        self._connection.setblocking(False)
        # The welcome was read through a buffer, which holds the beginning of what follows.
        begun = lines.peek()  # type: ignore[attr-defined]
        self._lines = Channel(self._connection.fileno(), longest=1 << 20, begun=begun)
        self.name = welcome.name
        self._views: list[Any] = []
        self._side = 0
        """How large pictures are wanted, pixels; 0 for none."""
        self._shown_s = float("-inf")

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self._lines.ended

    def hear(self) -> None:
        """Take the views that have come; `ended` once the run is over."""
        from sattrack.views.picture import PicturesWanted
        from sattrack.views.run import TrackView

        self._lines.flush()
        while not self.ended and select.select([self._lines], [], [], 0.0)[0]:
            for line in self._lines.lines():
                if line.startswith(b'{"type":"view"'):
                    with contextlib.suppress(msgspec.MsgspecError):
                        self._views = [*self._views[-40:], msgspec.json.decode(line, type=TrackView)]
                elif line.startswith(b'{"type":"pictures_wanted"'):
                    self._side = msgspec.json.decode(line, type=PicturesWanted).side

    def expected(self, frame: CameraFrame, geometry: ImageGeometry) -> ExpectedMotion | None:
        """Return how stars and the satellite move in an image, by the run's views about its instant."""
        from sattrack.camera.centring import expected

        return expected(self._views, float(frame.utc.unix_s), geometry.turned(self.field_angle_deg(frame)))

    def field_angle_deg(self, frame: CameraFrame) -> float:
        """Return by how much the tube was turned against the sky at a frame; 0 for an equatorial mount."""
        utc_s = float(frame.utc.unix_s)
        known = [view for view in self._views if view.axes is not None]
        if not known:
            return 0.0
        near = min(known, key=lambda view: abs(view.utc_s - utc_s))
        return float(near.axes.field_angle_deg + (utc_s - near.utc_s) * near.axes.field_rate_deg_s)

    def elsewhere(self, frame: CameraFrame, seen: Centred) -> str | None:
        """Return that a solved field lies far from where the mount pointed, as text; None where it does not.

        Directions of date and of the catalogue differ by less than what counts as far.
        """
        utc_s = float(frame.utc.unix_s)
        known = [one for one in self._views if one.mount_ra_deg is not None and one.mount_dec_deg is not None]
        near = min(known, key=lambda view: abs(view.utc_s - utc_s), default=None)
        if seen.field is None or seen.solved is None or near is None or abs(near.utc_s - utc_s) > NEAR_S:
            return None
        apart_deg = separation_deg(
            near.mount_ra_deg, near.mount_dec_deg, seen.field.ra_deg, seen.field.dec_deg
        )
        if apart_deg <= max(FAR_DEG, frame.pixels.shape[1] * seen.solved["scale_arcsec_px"] / 3600.0):
            return None
        return (
            f"the stars show a field {apart_deg:.1f}° from where the mount points: "
            "does the camera look along the telescope, and is the mount synced?"
        )

    def send(self, message: Any) -> bool:
        """Send an observation; return whether it went."""
        from sattrack.views.messages import encode_message

        self._lines.send(encode_message(message))
        return not self._lines.ended

    def show(self, frame: CameraFrame, detection: Detection, geometry: ImageGeometry, seen: Centred) -> None:
        """Send a frame to the screens that want pictures, if any; one that must wait is left out."""
        from sattrack.camera.centring import picture
        from sattrack.views.picture import MOST_PICTURE_BYTES, PICTURES_A_SECOND

        now_s = time.monotonic()
        due = now_s - self._shown_s >= 1.0 / PICTURES_A_SECOND
        if not self._side or not due or self._lines.waiting or self.ended:
            return
        lies = geometry.turned(self.field_angle_deg(frame))
        line = msgspec.json.encode(picture(frame, detection, lies, seen, self._side)) + b"\n"
        if len(line) <= MOST_PICTURE_BYTES:
            self._shown_s = now_s
            self._lines.send(line)

    def close(self) -> None:
        """Leave the run."""
        self._connection.close()


def _run(pid: int | None) -> ObservationLink | None:
    """Return the run that goes on, if there is one. Raises SattrackError, BadInputError for several."""
    from sattrack.cli.attach import chosen_run
    from sattrack.runtime.view_server import SUPPORTED, feeders

    if pid is None and not (SUPPORTED and feeders()):
        tell("no run is active: what is seen is only printed")
        return None
    return ObservationLink(chosen_run(pid))


def _awaited(pid: int) -> ObservationLink:
    """Return the run that is about to begin in the process that has started this one."""
    until_s = time.monotonic() + RUN_WITHIN_S
    while True:
        try:
            return ObservationLink(pid)
        except SattrackError:
            if time.monotonic() > until_s:
                raise
            time.sleep(TRY_AGAIN_S)


class Looker:
    """Finds the satellite and the stars' field in the frames of one camera."""

    def __init__(
        self, detector: Detector, geometry: ImageGeometry, name: str, solves: bool, waits: bool
    ) -> None:
        """Take `waits`: whether frames wait for the solver, which takes its time once."""
        self.detector, self.geometry, self.name = detector, geometry, name
        self._solves, self._waits = solves, waits
        self.lies_still = True
        """Whether the image lies on the sky as it did in the frame before."""
        self._solver: Solver | None = None
        self._making: subprocess.Popen[bytes] | None = None
        self._unfound = 0.0
        """How many fields were not found before the first that was."""
        self._told: set[str] = set()

    def look(
        self, frame: CameraFrame, expected: ExpectedMotion | None, field_angle_deg: float = 0.0
    ) -> tuple[Centred, Detection]:
        """Return what one frame comes to; `field_angle_deg` is how the tube was turned against the sky."""
        from sattrack.camera.centring import centred
        from sattrack.camera.frames import COARSE_S

        if frame.decimal_s > COARSE_S:
            self._tell(
                "frames are dated to whole seconds, and may be off by one, a satellite by up to 1°: "
                "let the capture program write fractions of a second"
            )
        detection = self.detector.look(frame, expected)
        solution = self._solution(frame, detection, field_angle_deg)
        return centred(frame, detection, self.geometry.of_header(frame), solution, self.name), detection

    def _solution(self, frame: CameraFrame, detection: Detection, field_angle_deg: float) -> Solution | None:
        from sattrack.camera.centring import FEWEST_STARS, ImageGeometry, contradiction

        scale = self.geometry.of_header(frame).scale_arcsec_px
        if self._solves and scale is None:
            self._tell("fields are not solved: no scale is known; give --scale ARCSEC_PER_PIXEL")
        if not self._solves or scale is None or len(detection.stars) < FEWEST_STARS:
            return None
        if self._solver is None:
            self._solver = self._made_solver(scale * frame.pixels.shape[1] / 3600.0)
        if self._solver is None:
            return None
        solution = self._solver.solve(frame.pixels.shape, detection.stars)
        if solution is None:
            self._not_found(scale, len(detection.stars))
            return None
        self._unfound = -math.inf
        if not self.lies_still:
            return solution
        wrong = contradiction(self.geometry.turned(field_angle_deg), solution)
        if wrong is not None:
            self._tell(wrong)
        # What the stars have shown holds for frames without a solution too.
        shown = ImageGeometry(solution.scale_arcsec_px, solution.rotation_deg, solution.flipped)
        self.geometry = shown.turned(-field_angle_deg)
        return solution

    def _not_found(self, scale: float, stars: int) -> None:
        """Say that a field is not found, where none was before."""
        self._unfound += 1
        if self._unfound == (1 if self._waits else MANY_UNFOUND):
            self._tell(
                f"the field is not found among the catalogue's by its {stars} stars: "
                f"the scale, {scale:.4g}″ a pixel, must be right within 30 %"
            )

    def _made_solver(self, fov_deg: float) -> Solver | None:
        """Return the solver; None while its index is made, and where there will be none."""
        from sattrack.camera.centring import Solver
        from sattrack.camera.star_index import LEAST_FOV_DEG, LONGEST_FOV_DEG, index_file, start_making

        if not LEAST_FOV_DEG <= fov_deg <= LONGEST_FOV_DEG:
            span = f"{LEAST_FOV_DEG:g}° to {LONGEST_FOV_DEG:g}°"
            self._unsolved(f"a field of {fov_deg:.2g}° is not solved: the star catalogue is for {span}")
            return None
        try:
            package = needed("tetra3rs", "solving", "camera")
        except SattrackError as error:
            self._unsolved(f"fields are not solved: {error}")
            return None
        path = index_file(fov_deg)
        if not os.access(path, os.R_OK):
            if self._making is None:
                self._tell(f"making the index of stars for fields of {fov_deg:.2g}°, once: {path}")
                self._making = start_making(path, fov_deg)
            if self._waits:
                self._making.wait()
            if self._making.poll() is None:
                return None
            if self._making.returncode:
                self._unsolved(
                    f"fields are not solved: {path} cannot be made: is its disk full or read-only?"
                )
                return None
        try:
            return Solver(package.SolverDatabase.load_from_file(str(path)), fov_deg)
        except (OSError, ValueError, RuntimeError) as error:
            self._unsolved(f"fields are not solved: {path}: {error}; remove it")
            return None

    def _unsolved(self, why: str) -> None:
        self._solves = False
        self._tell(why)

    def _tell(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            tell(text)


def _watch(
    context: CommandContext,
    items: Iterator[CameraFrame | SattrackError],
    camera: FrameSource,
    look: Looker,
    run: ObservationLink | None,
    save: Path | None,
) -> int:
    """Look at frame after frame; return the exit code."""
    from sattrack.camera.detection import light_wanted

    seen_frames = refused = 0
    elsewhere: str | None = None
    for item in items:
        if isinstance(item, SattrackError):
            refused += 1
            if refused <= MOST_REFUSALS_TOLD:
                tell(str(item))
            continue
        seen_frames += 1
        expected = None
        if run is not None:
            run.hear()
            expected = run.expected(item, look.geometry.of_header(item))
        turned_deg = 0.0 if run is None else run.field_angle_deg(item)
        seen, detection = look.look(item, expected, turned_deg)
        sent = run is not None and all(run.send(one) for one in seen.messages)
        if run is not None:
            run.show(item, detection, look.geometry.of_header(item), seen)
            if elsewhere is None and (elsewhere := run.elsewhere(item, seen)) is not None:
                tell(elsewhere)
        if save is not None:
            try:
                _save(item, save, look, seen)
            except SattrackError as error:
                if run is None:
                    raise
                # The run goes on, and needs what is seen.
                tell(f"{error}; no more frames are kept")
                save = None
        camera.adjust(light_wanted(item, detection))
        _print(context.json, seen, sent)
    if can_draw_lines_anew() and not context.json:
        click.echo(err=True)
    if refused > MOST_REFUSALS_TOLD:
        tell(f"{refused} files cannot be used")
    if not seen_frames:
        raise BadInputError("there was no frame that can be used")
    return 0


def _items(camera: FrameSource, run: ObservationLink | None) -> Iterator[CameraFrame | SattrackError]:
    """Yield a camera's frames until the run ends."""
    for item in camera.frames():
        if run is not None:
            run.hear()
            if run.ended:
                return
        yield item


def _save(frame: CameraFrame, folder: Path, look: Looker, seen: Centred) -> None:
    from sattrack.camera.files import save_frame

    solved = seen.solved or {}
    fields = {"RA": solved["ra_deg"], "DEC": solved["dec_deg"]} if solved else {}
    scale = solved.get("scale_arcsec_px", look.geometry.of_header(frame).scale_arcsec_px)
    if scale is not None:
        fields["SCALE"] = scale
    save_frame(frame, folder, look.name, fields)


def _print(as_json: bool, seen: Centred, sent: bool) -> None:
    if as_json:
        sys.stdout.write(json.dumps(seen.document(sent), allow_nan=False) + "\n")
        sys.stdout.flush()
        return
    from sattrack.views.formatting import iso_unix_s

    clock = local_time.clock(iso_unix_s(seen.utc), 3)
    if seen.kind == "none":
        text = f"{clock}  nothing: {seen.why}"
    elif seen.dx_arcsec is None:
        text = f"{clock}  {seen.kind}  SNR {seen.snr}, in pixels: no --scale"
    else:
        solved = (
            ""
            if seen.solved is None
            else f"  field {seen.solved['ra_deg']:.3f} {seen.solved['dec_deg']:+.3f}"
        )
        text = (
            f"{clock}  {seen.kind:<6} right {seen.dx_arcsec:8.2f}″  up {seen.dy_arcsec:8.2f}″  "
            f"± {seen.sigma_arcsec:.2f}″  SNR {seen.snr:.0f}{solved}"
        )
    if can_draw_lines_anew() and sys.stdout.isatty():
        renew(text)
    else:
        say(text)
