"""The operator's and the observers' messages, turned into offsets of the direction that is fed. Pure."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import msgspec

from sattrack.control.biases import (
    ALONG,
    CROSS,
    Biases,
    begin_search,
    change_offset,
    clear_biases,
    end_reached,
    end_search,
    follow_estimate,
    forget_estimate,
    nudge_biases,
)
from sattrack.control.camera_clock import CameraClocks
from sattrack.control.camera_image import AS_SET, KEPT, STEP_S, Deviation, ImageFit
from sattrack.control.estimate import LOST_AFTER_S, Estimator, known_terms
from sattrack.views.messages import (
    LEAST_SIGMA_ARCSEC,
    MOST_OFFSET_ARCSEC,
    MOST_SIGMA_ARCSEC,
    ClearBias,
    DropRemembered,
    Guide,
    Nudge,
    ObservationMessage,
    OffsetBy,
    Search,
    SeenOffset,
)
from sattrack.views.run import CameraView
from tle.bias import Bias
from tle.errors import PropagationError
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.control.camera_image import Camera, Cameras
    from sattrack.mount.model import MountProfile
    from sattrack.views.messages import Message
    from sattrack.views.run import RememberedView
    from tle.orbit_fit import Image
    from tle.propagator import Propagator

REACTION_PERIODS = 3.0
REFUSAL_SHOWN_S = 5.0
FOLLOW_AGAIN_S = 0.5
"""How often an estimate is looked at whose observations have ended."""
SEARCHED_SIGMAS = 2.0
FIELDS_A_SECOND, ARMS_FIELDS = 0.5, 0.7
"""How fast a search goes, and how far the arms of a spiral are apart, in fields of the camera."""
SLOWER_STEPS = 12
GEOMETRIES_KEPT = 4
AGAIN_AT_ONCE = 2
"""In a period no more observations are used than that."""
SAME_ALONG_S, SAME_CROSS_KM = 2e-6, 1e-5
"""An estimate that differs by less from what is fed, hundredths of an arcsecond, is no news."""


Seen = TypeVar("Seen", ObservationMessage, SeenOffset)


class OffsetOnAxes(NamedTuple):
    """A satellite beside the middle of an image, arcseconds towards growing angles of the two axes."""

    utc_s: float
    first_arcsec: float
    second_arcsec: float


class Steering:
    """The offsets and the estimate of one run, and what was last not done of what was asked."""

    def __init__(
        self,
        propagator: Propagator,
        profile: MountProfile,
        bias: Bias,
        cameras: Cameras,
        start_utc_s: float,
        remembered: RememberedView | None = None,
    ) -> None:
        self.cameras = cameras
        self._seen_by: dict[str, tuple[Camera, ...]] = {}
        """In which ways the image of each camera was said to lie, the last one last."""
        self._images: dict[str, ImageFit] = {}
        self._offsets: dict[str, deque[SeenOffset]] = {}
        """The last offsets of each camera, as they came."""
        self._again: deque[tuple[SeenOffset, bool]] = deque()
        """Those to be taken once more, as their image lies otherwise; with False those that came since."""
        self._searched_since_s = float("inf")
        """Of which last observation the loss has been searched for."""
        self._delay_s = REACTION_PERIODS * profile.period_s + profile.command_delay_s
        self.biases = Biases(bias, propagator, profile, cameras.other)
        self.estimator = Estimator(propagator.elements.catalog_number, start_utc_s, known_terms(profile.sky))
        self.refusal: str | None = None
        """Why the operator's last word was not obeyed, in words."""
        self._refused_utc_s = float("-inf")
        self._begun_s = float("-inf")
        self._estimated = False
        """Whether the estimate is news that is not followed yet."""
        self._following_estimate = False
        self._followed_s = float("-inf")
        self._led = True
        """Whether an orbit may begin with what is fed: not with what a wrong image led to, which has the
        mount's errors in it too."""
        self.clocks = CameraClocks(profile)
        self.guided = True
        """Whether observations correct the target; else the last one is kept, and shown."""
        self._kept: ObservationMessage | SeenOffset | None = None
        """The last observation that was not taken, for the operator to accept."""
        self.last_offset: OffsetOnAxes | None = None
        """Where a camera saw the satellite last; None where that offset could not be used."""
        self._remembered = remembered
        self._nudged = {ALONG: 0.0, CROSS: 0.0}
        """What is left in the operator's offsets of a nudge that was remembered."""
        if remembered is not None and remembered.cross_deg is not None:
            self._nudged = {ALONG: remembered.along_s, CROSS: remembered.cross_deg}
        if remembered is not None and remembered.cross_km is not None:
            self.biases.begin_estimated(remembered.along_s, remembered.cross_km)

    @property
    def remembered(self) -> RememberedView | None:
        """The bias of an earlier pass, and its outcome."""
        known = self._remembered
        if known is None or known.state != "in force" or not self._following_estimate:
            return known
        return msgspec.structs.replace(known, state="replaced")

    def obey(self, message: Message, now_utc_s: float) -> None:
        """Do what a message says of offsets; others are none of its business."""
        self.last_offset = None
        begins_s = self._begins_s(now_utc_s)
        if isinstance(message, ObservationMessage | SeenOffset):
            self._take(message, now_utc_s, begins_s)
            return
        try:
            answer = self._answer(message, now_utc_s, begins_s)
        except PropagationError as error:
            answer = f"nothing is offset: {error}"
        self.tell(answer, now_utc_s)

    def _answer(self, message: Message, now_utc_s: float, begins_s: float) -> str | None:
        """Change offsets as a message says; return why not. Raises PropagationError where the target ends."""
        answer = None
        match message:
            case Guide():
                answer = self._guide(message.how, now_utc_s, begins_s)
            case Nudge():
                answer = nudge_biases(self.biases, message.along_s, message.cross_deg, begins_s)
            case OffsetBy():
                answer = change_offset(self.biases, message, begins_s)
                if answer is None and message.how in {"set", "gradual", "reset"}:
                    self._nudged[message.what] = 0.0
            case Search(how="auto"):
                answer = self._search_by_covariance(begins_s)
            case Search():
                answer = begin_search(self.biases, message, begins_s)
            case DropRemembered():
                answer = self._drop_remembered(begins_s)
            case ClearBias():
                self._end_remembered("cleared")
                self.estimator.forget()
                self._again.clear()
                self._estimated = self._following_estimate = False
                self._led = True
                clear_biases(self.biases, begins_s)
        return answer

    def _take(
        self, seen: ObservationMessage | SeenOffset, now_utc_s: float, begins_s: float, sure: bool = False
    ) -> None:
        """Take in what was seen; keep it for the operator where it is not taken."""
        if not (self.guided or sure):
            self._kept = seen
            return
        if isinstance(seen, ObservationMessage):
            self._observe(self._dated(seen), now_utc_s, begins_s, sure=sure)
        else:
            self._offsets.setdefault(seen.camera or "", deque(maxlen=KEPT)).append(seen)
            self._see(self._dated(seen), now_utc_s, begins_s, sure)
            if self._again and self._again[-1][0] is not seen:
                self._again.append((seen, False))
        self._kept = None if self.estimator.words is None else seen

    def _dated(self, seen: Seen) -> Seen:
        """Return what was seen with the date that it has by what is known of its camera's clock."""
        ahead_s = self.ahead_s(seen.camera)
        if not ahead_s:
            return seen
        return msgspec.structs.replace(seen, utc=Utc.parse(seen.utc).plus(-ahead_s).isoformat("microseconds"))

    def _take_again(self, now_utc_s: float) -> None:
        """Take the next offsets that were seen before it was known how their image lies."""
        for _ in range(min(AGAIN_AT_ONCE, len(self._again))):
            seen, is_counted = self._again.popleft()
            known = self.estimator
            counts = known.accepted, known.rejected, known.refused
            self._see(self._dated(seen), now_utc_s, self._begins_s(now_utc_s), sure=False, again=True)
            if is_counted:
                known.accepted, known.rejected, known.refused = counts

    def _leave_clocks_to_the_stars(self) -> None:
        """Drop what images showed of the clocks of cameras that the stars have corrected."""
        for name, found in tuple(self.estimator.deviations.items()):
            if self.clocks.correction_s(name):
                left = found._replace(clock_s=0.0)
                if left == AS_SET:
                    del self.estimator.deviations[name]
                else:
                    self.estimator.deviations[name] = left

    def ahead_s(self, camera: str | None) -> float:
        """Return what must be taken off a camera's dates: what its fields showed, and its images."""
        return self.clocks.correction_s(camera) + self.estimator.deviations.get(camera or "", AS_SET).clock_s

    @property
    def last_seen(self) -> str | None:
        """The outcome of the last observation, in words; None before there was one."""
        if self._kept is not None and not self.guided:
            return "held"
        return self.estimator.words or ("taken" if self.estimator.accepted else None)

    def _guide(self, how: str, now_utc_s: float, begins_s: float) -> str | None:
        """Obey the operator about observations; return why nothing was done, in words."""
        if how in {"on", "off"}:
            self.guided, self._kept = how == "on", None
            self._again.clear()
            return None
        if how == "accept":
            kept = self._kept
            if kept is None:
                return "nothing to accept: the last observation was taken"
            self._take(kept, now_utc_s, begins_s, sure=True)
            return None if self.estimator.words is None else f"not accepted: {self.estimator.words}"
        if not self.estimator.undo():
            return "nothing to reject: no observation was taken since"
        self._estimated = self.estimator.filter is not None
        if not self._estimated:
            self._leave_estimate(begins_s)
        return None

    def _leave_estimate(self, begins_s: float) -> None:
        """Follow what is known without observations: what an estimate has replaced does not come back."""
        was_followed = self._following_estimate
        self._estimated = self._following_estimate = False
        self._led = True
        if was_followed:
            forget_estimate(self.biases, begins_s)
            self._end_remembered("replaced")

    def keep_search(self, now_utc_s: float) -> None:
        """End a search that runs, keeping where it is."""
        begins_s = self._begins_s(now_utc_s)
        if self.biases.pattern_at(begins_s) is not None:
            end_search(self.biases, True, begins_s)

    def watch(self, now_utc_s: float, on_target_utc_s: float | None = -math.inf) -> bool:
        """Follow the estimate where there is a new one, end what has gone as far as it may; tell of either.

        To be called once a period. `on_target_utc_s` is since when the mount is on the target, None where it
        is not: then the camera cannot see the target, and nothing is searched for.
        """
        self._take_again(now_utc_s)
        if self.clocks.waiting and self.clocks.watch(self.biases.course):
            # What was seen by the wrong dates is of another place.
            self.estimator.forget()
            self._images.clear()
            self._leave_clocks_to_the_stars()
        self._estimated |= self.estimator.catch_up()
        ended = None if on_target_utc_s is None else self._search_if_lost(now_utc_s, on_target_utc_s)
        due = self._following_estimate and now_utc_s - self._followed_s >= FOLLOW_AGAIN_S
        news = self.estimator.filter is not None and (self._estimated or due) and self._follow(now_utc_s)
        if ended is None and self.biases.moving:
            ended = end_reached(self.biases, self._begins_s(now_utc_s))
        if ended is not None:
            self.tell(ended, now_utc_s)
        return news or ended is not None

    def _follow(self, now_utc_s: float) -> bool:
        """Feed what the estimate says where that is not fed yet; tell whether something changed.

        What it says drifts and bends over a pass: between two looks it is followed as a parabola.
        """
        begins_s = self._begins_s(now_utc_s)
        read = self.estimator.reading(begins_s, self.biases.course, fed=True)
        found, self._estimated, self._followed_s = self._estimated, False, now_utc_s
        if read is None:
            return False
        first = not self._following_estimate
        if found:
            self._searched_since_s = float("inf")
        lasting_s = begins_s + FOLLOW_AGAIN_S
        half = 0.5 * FOLLOW_AGAIN_S**2
        along_s = read.along_s + FOLLOW_AGAIN_S * read.along_rate + half * read.along_curve
        off_s = along_s - self.biases.estimated_along.total_at(lasting_s)
        cross_km = read.cross_km + FOLLOW_AGAIN_S * read.cross_rate_km_s + half * read.cross_curve_km_s2
        off_km = cross_km - self.biases.estimated_cross_km.total_at(lasting_s)
        finds = found and self.biases.pattern_at(begins_s) is not None
        if not first and not finds and abs(off_s) < SAME_ALONG_S and abs(off_km) < SAME_CROSS_KM:
            return False
        follow_estimate(self.biases, read, first, begins_s, first or found)
        self._following_estimate = True
        return True

    def _search_if_lost(self, now_utc_s: float, on_target_utc_s: float) -> str | None:
        """Begin a search where the target is lost and may be out of the field; return that, in words."""
        last_s = self.estimator.last_utc_s
        if not self.cameras.search_when_lost or last_s is None:
            return None
        if now_utc_s - max(last_s, on_target_utc_s) < LOST_AFTER_S:
            return None
        begins_s = self._begins_s(now_utc_s)
        if (
            not self.guided
            or last_s == self._searched_since_s
            or self.biases.pattern_at(begins_s) is not None
        ):
            return None
        if self._search_by_covariance(begins_s) is not None:
            return None
        self._searched_since_s = last_s
        return "the target is lost, and may be out of the field: searching"

    def _search_by_covariance(self, begins_s: float) -> str | None:
        """Search where the target may be, by what is known of it; return why not, in words.

        Along the track where it is uncertain along it alone, else in a spiral; as fast as the mount and the
        camera's field allow.
        """
        read = self.estimator.reading(begins_s, self.biases.course, fed=True)
        field_deg = self.cameras.field_deg
        if read is None:
            return "auto refused: nothing seen yet shows where to search"
        if field_deg is None:
            return "auto refused: the camera's field is not known; give --fov, or set it in [camera]"
        going = self.biases.course.going(begins_s + read.along_s)
        along_deg = SEARCHED_SIGMAS * read.along_sigma_s * going.pace_deg_s
        cross_deg = SEARCHED_SIGMAS * math.degrees(read.cross_sigma_km / going.range_km)
        half_deg = 0.5 * field_deg
        if math.hypot(along_deg, cross_deg) < half_deg:
            return "auto refused: the target is within the camera's field by what is known"
        why, speed_deg_s = "", FIELDS_A_SECOND * field_deg
        for _ in range(SLOWER_STEPS):
            if cross_deg < half_deg:
                turn_s = max(2.0, 2.0 * math.pi * along_deg / speed_deg_s)
                order = Search("sweep", reach_s=SEARCHED_SIGMAS * read.along_sigma_s, period_s=turn_s)
            else:
                arms_deg = min(2.0, max(0.001, ARMS_FIELDS * field_deg))
                order = Search("spiral", spacing_deg=arms_deg, speed_deg_s=min(2.0, speed_deg_s))
            refused = begin_search(self.biases, order, begins_s)
            if refused is None:
                return None
            why, speed_deg_s = refused, 0.7 * speed_deg_s
        return why

    def _drop_remembered(self, begins_s: float) -> str | None:
        known = self.remembered
        if known is None or known.state != "in force":
            return "no remembered bias is in force" + ("" if known is None else f": it was {known.state}")
        answer = None
        if known.cross_deg is None:
            forget_estimate(self.biases, begins_s)
        else:
            answer = nudge_biases(self.biases, -self._nudged[ALONG], -self._nudged[CROSS], begins_s)
        if answer is None:
            self._end_remembered("dropped")
        return answer

    def _end_remembered(self, state: str) -> None:
        known = self.remembered
        if known is not None and known.state == "in force":
            self._remembered = msgspec.structs.replace(known, state=state)

    def _begins_s(self, now_utc_s: float) -> float:
        """Return when a change that is asked for now begins: when a command that knows of it can act."""
        self._begun_s = max(self._begun_s, now_utc_s + self._delay_s)
        return self._begun_s

    def _see(
        self, seen: SeenOffset, now_utc_s: float, begins_s: float, sure: bool, again: bool = False
    ) -> None:
        """Take in the direction in which an offset was seen, relative to the one fed at its instant."""
        utc_s = float(Utc.parse(seen.utc).unix_s)
        if utc_s < self.biases.known_since_utc_s:
            self.estimator.refuse(f"it is of {seen.utc}: what was fed then is not known any more")
            return
        name, said = seen.camera or "", self._said_of(seen)
        in_arcsec = said.in_arcsec(seen)
        if in_arcsec is None:
            self.estimator.refuse(
                f"it is in pixels, and their size is not known: give scale_arcsec_px, or set it in "
                f"[cameras.{name or 'NAME'}] of sattrack.toml"
            )
            return
        if not max(abs(one) for one in in_arcsec[:2]) <= MOST_OFFSET_ARCSEC:
            self.estimator.refuse(f"offsets go to {MOST_OFFSET_ARCSEC:g} arcseconds either way")
            return
        if not again:
            self._begin_anew_if_said_otherwise(name, said, now_utc_s)
            self._begin_anew_if_shown_otherwise(name, said, utc_s, complex(*in_arcsec[:2]), now_utc_s)
        camera = self.camera_of(seen)
        dx, dy, sigma = camera.in_arcsec(seen) or in_arcsec
        if not again:
            self.last_offset = OffsetOnAxes(utc_s, *camera.on_axes(dx, dy))
            if self._again:
                self.estimator.words = None
                return
        x, y = math.radians(dx / 3600.0), math.radians(dy / 3600.0)
        image = self.biases.image_at(utc_s, x, y, camera, name)
        there = image.fed + x * image.right + y * image.up
        ra_deg = math.degrees(math.atan2(there[1], there[0])) % 360.0
        dec_deg = math.degrees(math.atan2(there[2], math.hypot(there[0], there[1])))
        sigma_arcsec = min(MOST_SIGMA_ARCSEC, max(LEAST_SIGMA_ARCSEC, sigma))
        directed = ObservationMessage(seen.utc, ra_deg, dec_deg, "of_date", sigma_arcsec, camera=seen.camera)
        # What nothing explains is followed all the same: then the motion shows how the image lies.
        fit = self._images.get(name)
        begins = self.estimator.filter is None and fit is not None and fit.is_steady
        self._observe(directed, now_utc_s, begins_s, image, sure=sure or begins)

    def _begin_anew_if_said_otherwise(self, name: str, said: Camera, now_utc_s: float) -> None:
        """Begin the estimate anew where a camera says of its image what contradicts all that it said before.

        So it does once it has solved a field. The estimate may have taken what was set wrongly for an error
        of orbit or mount, and its terms are those of the wrong image. What two cameras of one name say in
        turns is nothing new.
        """
        before = self._seen_by.get(name, ())
        alike = [one for one in before if one.otherwise(said) is None]
        self._seen_by[name] = (*(one for one in before if one not in alike), said)[-GEOMETRIES_KEPT:]
        if before and not alike:
            believed = self.estimator.deviations.pop(name, AS_SET).applied_to(before[-1])
            self._images.pop(name, None)
            words = believed.otherwise(said)
            if words is not None:
                self._begin_anew(name, "field shows", words, now_utc_s)

    def _begin_anew_if_shown_otherwise(
        self, name: str, said: Camera, utc_s: float, seen_arcsec: complex, now_utc_s: float
    ) -> None:
        """Begin the estimate anew where what the mount's motion does to an image contradicts how it lies."""
        try:
            predicted = [self.biases.predicted_at(utc_s + k * STEP_S, said) for k in (-1.0, 0.0, 1.0)]
            motion = self.biases.motion_at(utc_s, said)
        except PropagationError:
            return
        fit = self._images.setdefault(name, ImageFit())
        fit.see(utc_s, predicted, math.radians(1.0 / 3600.0) * seen_arcsec, motion)
        believed = self.estimator.believed_of(name)
        before = self.estimator.deviations.get(name, AS_SET)
        shown = fit.deviation(said.flip, believed)
        if shown is not None:
            words = believed.applied_to(said).otherwise(shown.applied_to(said))
            if words is not None:
                self.estimator.deviations[name] = shown._replace(clock_s=before.clock_s)
                self._begin_anew(name, "images show", words, now_utc_s)
            return
        ahead_s = fit.clock_s(said.flip, believed)
        if ahead_s is not None:
            self.estimator.deviations[name] = before.and_then(Deviation(clock_s=ahead_s))
            self._images.pop(name)
            words = (
                f"dates {abs(ahead_s):.2f} s {'ahead of' if ahead_s > 0.0 else 'behind'} the mount's motion"
            )
            self._begin_anew(name, "images show", words, now_utc_s)

    def _begin_anew(self, name: str, what: str, shown: str, now_utc_s: float) -> None:
        """Begin the estimate anew: an image lies otherwise than was believed, in words."""
        self.estimator.forget()
        self._again.clear()
        if what == "images show":
            *before, last = self._offsets[name]
            self._again.extend([*((seen, True) for seen in before), (last, False)])
        self._led = not self._following_estimate
        self.tell(
            f"camera {name or 'without a name'}: its {what} {shown}: the estimate begins anew; "
            "correct its settings",
            now_utc_s,
        )

    def camera_views(self) -> tuple[CameraView, ...]:
        """Return the cameras whose offsets were taken, and what was found of them."""
        known, found = self.estimator.filter, []
        for name in () if known is None else known.cameras:
            camera = self._seen_by[name][-1]
            values, sigmas = self.estimator.found_of(name)
            found.append(
                CameraView(
                    name,
                    camera.kind,
                    camera.rotation_deg,
                    camera.flip,
                    camera.scale_arcsec_px,
                    values["rotation_deg"],
                    sigmas["rotation_deg"],
                    values["scale"],
                    sigmas["scale"],
                    values["clock_s"],
                    sigmas["clock_s"],
                    self.estimator.deviations.get(name, AS_SET).mirrored,
                )
            )
        return tuple(found)

    def camera_of(self, seen: SeenOffset) -> Camera:
        """Return how the camera's image lies: as it was found, else as it says."""
        return self.estimator.deviations.get(seen.camera or "", AS_SET).applied_to(self._said_of(seen))

    def _said_of(self, seen: SeenOffset) -> Camera:
        """Return how the camera's image lies: as the message says, else as the run knows it by its name."""
        known = self.cameras.named.get(seen.camera or "", self.cameras.other)
        return known._replace(
            rotation_deg=known.rotation_deg if seen.rotation_deg is None else seen.rotation_deg,
            flip=known.flip if seen.flipped is None else seen.flipped,
            scale_arcsec_px=seen.scale_arcsec_px or known.scale_arcsec_px,
        )

    def _observe(
        self,
        seen: ObservationMessage,
        now_utc_s: float,
        begins_s: float,
        image: Image | None = None,
        *,
        sure: bool = False,
    ) -> None:
        """Take an observation in; the estimate is followed from the next period on."""
        along_s, cross_deg = self.biases.totals(begins_s)
        first = Bias(along_s, cross_deg)
        if self.estimator.take(
            seen, now_utc_s, self.biases.course, first, image, sure=sure, patient=True, led=self._led
        ):
            self._estimated = self._led = True
        elif self.estimator.refuted:
            self.estimator.forget()
            self._leave_estimate(begins_s)
            self.tell("observations contradict one another: back to the elements", now_utc_s)

    def tell(self, words: str | None, now_utc_s: float) -> None:
        """Keep why something was not done, until something else has been done some seconds later."""
        if words is not None or now_utc_s - self._refused_utc_s > REFUSAL_SHOWN_S:
            self.refusal, self._refused_utc_s = words, now_utc_s
