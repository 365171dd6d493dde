"""Acoustic positioning as the rest of the extension sees it: the topic, the API's answers, words for the pilot."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import orjson

from bluerov_slam.acoustics.message.report import BeaconReport, MessageContentError
from bluerov_slam.config import Settings
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.acoustic_callers import HELD_TEXTS
from bluerov_slam.pipeline.acoustic_watch import (
    NAVIGATION_OFF,
    NOT_DESCRIBED,
    NOT_FITTED,
    AcousticState,
    AcousticWatch,
    AcousticWords,
)
from bluerov_slam.pipeline.health_acoustics import acoustic_parts
from bluerov_slam.pipeline.health_model import AcousticFacts
from bluerov_slam.protocol.acoustic_json import fix_json
from bluerov_slam.records import (
    AcousticFix,
    AcousticMessage,
    AcousticRecord,
    NavState,
    TimeDifferenceReading,
)
from bluerov_slam.services.acoustic_settings import acoustic_options
from bluerov_slam.services.acoustics_input import AcousticsInput
from bluerov_slam.services.hub import Hub
from bluerov_slam.sinks.websocket import Broadcaster

TOPIC: Final = "acoustics"
# After so long without any frame nobody need be told that an array could be described.
FORGOTTEN_S: Final = 60.0
# A sentence is on the chip, and its fault is told, once it has stood for so long: what flickers is not.
TOLD_AFTER_S: Final = 3.0
_FIRST_PRINTABLE: Final = 0x20
_LAST_PRINTABLE: Final = 0x7E


class AcousticsService:
    """Listens on the hub; `tick` it once a second."""

    def __init__(
        self,
        hub: Hub,
        broadcaster: Broadcaster,
        settings: Callable[[], Settings],
        *,
        now_s: Callable[[], float],
        unix_s: Callable[[float], float],
        simulated: bool,
    ) -> None:
        self.input = AcousticsInput(hub, now_s)
        self.record: AcousticRecord | None = None
        self._hub = hub
        self._broadcaster = broadcaster
        self._settings = settings
        self._now_s = now_s
        self._unix_s = unix_s
        self._simulated = simulated
        self._watch = AcousticWatch()
        self._fix: AcousticFix | None = None
        self._message: AcousticMessage | None = None
        self._heard_s = -math.inf
        self._origin_deg: tuple[float, float] | None = None
        self._counts = {"pings": 0, "rejected": 0, "held_back": 0, "missing_samples": 0}
        self._settled: AcousticWords | None = None
        self._since: tuple[tuple[AcousticState, str], float] | None = None
        hub.subscribe(self._on_fix, AcousticFix, name="acoustics")
        hub.subscribe(self._on_reading, TimeDifferenceReading, name="acoustics")
        hub.subscribe(self._on_record, AcousticRecord, name="acoustics")
        hub.subscribe(self._on_message, AcousticMessage, name="acoustics")
        hub.subscribe(self._on_state, NavState, name="acoustics")

    def apply_settings(self) -> None:
        """Another array, another place: what was concluded from the old one says nothing."""
        self._watch = AcousticWatch()
        self._fix = self._settled = self._since = None
        self.publish()

    def tick(self) -> None:
        """Once a second: ages, and what has stood for longer than a moment."""
        self.input.tick()
        self._settle(self._now_s())
        self.publish()

    def publish(self) -> None:
        """Send the topic, if anybody listens."""
        if self._broadcaster.wants(TOPIC):
            self._broadcaster.publish_text(TOPIC, self.message())

    def message(self) -> bytes:
        """The whole message of the topic, now."""
        at_s = self._now_s() if self._fix is None else self._fix.measured_s
        return orjson.dumps({"topic": TOPIC, "t": round(self._unix_s(at_s), 4), "data": self.data()})

    def data(self) -> dict[str, Any]:
        """The topic's object, now."""
        now_s = self._now_s()
        settings, words, fix = self._settings(), self.words(now_s), self._fix
        options = acoustic_options(settings)
        content = fix_json(fix, 0 if options is None else len(options.array))
        place, raw_bits = content.pop("place"), content.pop("raw_bits")
        if content["beacon"] is None and options is not None and options.beacon_deg is not None:
            content["beacon"] = {
                "latitude_deg": options.beacon_deg[0],
                "longitude_deg": options.beacon_deg[1],
                "depth_m": options.beacon_depth_m,
                "source": "settings",
            }
        if content["beacon"] is not None:
            content["beacon"] |= self._local(content["beacon"])
        return {
            "enabled": options is not None,
            "state": words.state.value,
            "text": words.text,
            "cure": words.cure,
            "age_s": None if fix is None else round(max(0.0, now_s - fix.arrived_s), 2),
            **content,
            "message": None if self._message is None else _message_json(self._message, now_s),
            "raw_bits": raw_bits,
            "fix": None
            if place is None
            else {**self._local(place), **place, "accepted": content["accepted"], "reason": content["reason"]},
            **self._counts,
            "sources": list(self.input.sources),
            "simulated": self._simulated,
        }

    def record_json(self) -> dict[str, Any] | None:
        """What GET /api/acoustics/record answers: the newest raw record."""
        record = self.record
        if record is None:
            return None
        return {
            "record_id": record.record_id,
            "time_unix_s": round(self._unix_s(record.measured_s), 6),
            "sample_rate_hz": record.sample_rate_hz,
            "bits": record.bits,
            "trigger_index": record.trigger_index,
            "missing_samples": record.missing_samples,
            "holes": [list(hole) for hole in record.holes],
            "samples": record.samples.tolist(),
        }

    def words(self, now_s: float) -> AcousticWords:
        """The sentence for the pilot."""
        settings = self._settings()
        if not settings.acoustics.enabled:
            return NOT_DESCRIBED if now_s - self._heard_s < FORGOTTEN_S else NOT_FITTED
        if not settings.navigation.enabled:
            return NAVIGATION_OFF
        return self._watch.words(now_s)

    def facts(self) -> AcousticFacts:
        """For the chip and the faults."""
        now_s, fix = self._now_s(), self._fix
        return AcousticFacts(
            self._settle(now_s),
            None if fix is None else max(0.0, now_s - fix.arrived_s),
            acoustic_parts(fix, self._counts["pings"], self._counts["rejected"]),
        )

    def counters(self) -> dict[str, float]:
        """For Prometheus: what only grows."""
        return {
            **self.input.counters(),
            "acoustics_pings": self._counts["pings"],
            "acoustics_rejected": self._counts["rejected"],
            "acoustics_held_back": self._counts["held_back"],
        }

    def _on_fix(self, fix: AcousticFix) -> None:
        if not self._settings().acoustics.enabled:  # of a worker that is just being stopped
            return
        self._fix = fix
        self._counts["pings"] += 1
        self._counts["rejected"] += not fix.accepted
        self._counts["held_back"] += fix.reason in HELD_TEXTS
        self._watch.observe(fix)
        self.publish()

    def _on_reading(self, reading: TimeDifferenceReading) -> None:
        self._heard_s = reading.arrived_s

    def _on_record(self, record: AcousticRecord) -> None:
        self._heard_s = record.arrived_s
        self.record = record
        self._counts["missing_samples"] += record.missing_samples

    def _on_message(self, message: AcousticMessage) -> None:
        self._heard_s = message.arrived_s
        self._message = message

    def _on_state(self, state: NavState) -> None:
        self._origin_deg = state.origin_deg

    def _local(self, place: dict[str, Any]) -> dict[str, float | None]:
        """Where a place is on the map."""
        if self._origin_deg is None:
            return {"north_m": None, "east_m": None}
        north_m, east_m, _ = LocalFrame(*self._origin_deg).to_ned_m(place["latitude_deg"], place["longitude_deg"])
        return {"north_m": round(north_m, 2), "east_m": round(east_m, 2)}

    def _settle(self, now_s: float) -> AcousticWords:
        """What the chip says: a sentence that has stood for a while, with the figures of now."""
        words = self.words(now_s)
        key = (words.state, words.kind)
        if self._since is None or self._since[0] != key:
            self._since = (key, now_s)
        settled = self._settled
        if settled is None or (settled.state, settled.kind) == key or now_s - self._since[1] >= TOLD_AFTER_S:
            self._settled = settled = words
        return settled


def _message_json(message: AcousticMessage, now_s: float) -> dict[str, Any]:
    """What the transmitter said, in words where they are words."""
    said = message.payload
    printable = all(_FIRST_PRINTABLE <= byte <= _LAST_PRINTABLE for byte in said)
    text, report = said.decode("ascii") if printable else said.hex(" "), None
    try:
        report = BeaconReport.unpack(said)
        text = (
            "Position report" if report.latitude_deg is not None else "Position report of a transmitter without a fix"
        )
    except MessageContentError:
        pass
    return {
        "text": text,
        "latitude_deg": None if report is None else report.latitude_deg,
        "longitude_deg": None if report is None else report.longitude_deg,
        "std_m": None if report is None else report.horizontal_std_m,
        "depth_m": None if report is None else report.depth_m,
        "age_s": round(max(0.0, now_s - message.arrived_s), 1),
        "corrected_errors": message.corrected_errors,
        "bytes": said.hex(),
    }
