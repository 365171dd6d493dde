"""From a request of the page to settings read back from the sonar: checked, coalesced, sent, verified, explained."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bluerov_slam.errors import CommandError, ConfigError
from bluerov_slam.protocol.kogger import (
    BootAction,
    ChartSetup,
    Dataset,
    DatasetMask,
    Dsp,
    FirmwareInfo,
    FlashAction,
    KoggerFrame,
    KoggerId,
    ResultCode,
    SoundSpeed,
    Transceiver,
    VersionInfo,
    boot_frame,
    flash_frame,
    mark_frame,
    parse_version,
)
from bluerov_slam.records import Channel
from bluerov_slam.services.sonar_session import SonarSession, result_meaning
from bluerov_slam.services.sonar_settings import (
    LIMITS,
    READ_IDS,
    Asked,
    SonarSettings,
    check_asked,
    differences,
    merge_asked,
    plan,
)

logger = logging.getLogger(__name__)

# One question each, round and round: about 10 bytes a second up and 20 down.
REFRESH_PAUSE_S = 2.0
LINK_UP_TRIES = 3
# A sonar that was told to restart is asked again after this; one that is not back yet, a round of questions later.
RESTART_S = 3.0
DISTANCE_SETUP_VERSIONS = (1, 2)
VERSION_VERSIONS = (0, 1, 2)
# KoggerApp asks all of these once it knows the device: (id, version, payload).
REFRESH_ROUND: tuple[tuple[int, int, bytes], ...] = (
    *((KoggerId.VERSION, version, b"") for version in VERSION_VERSIONS),
    (KoggerId.CHART_SETUP, 0, b""),
    (KoggerId.DATASET, 0, b"\0"),
    (KoggerId.TRANSCEIVER, 0, b""),
    (KoggerId.SOUND_SPEED, 0, b""),
    (KoggerId.DSP, 0, b""),
    *((KoggerId.DISTANCE_SETUP, version, b"") for version in DISTANCE_SETUP_VERSIONS),
)
ACTIONS = ("save_to_flash", "reboot", "stop", "refresh")
CONFIRMED_ACTIONS = ("save_to_flash", "reboot")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one request to one sonar."""

    ok: bool
    asked: Mapping[str, Any]
    read: Mapping[str, Any]
    message: str

    def as_json(self) -> dict[str, Any]:
        return {"ok": self.ok, "asked": dict(self.asked), "read": dict(self.read), "message": self.message}


@dataclass(slots=True)
class _Sonar:
    """One sonar, what was asked of it last, and the requests waiting to be carried out together."""

    session: SonarSession
    asked: Asked = field(default_factory=dict)
    read_at_unix_s: float | None = None
    last_result: str | None = None
    waiting: Asked = field(default_factory=dict)
    batch: asyncio.Task[Outcome] | None = None
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    unanswered: set[tuple[int, int]] = field(default_factory=set)
    synchronise_wanted: bool = False


class CommandForwarder:
    """The settings of both sonars. `on_change` is called whenever `state()` may have changed."""

    def __init__(
        self,
        sessions: Mapping[Channel, SonarSession],
        wall_unix_s: Callable[[], float] = time.time,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.on_change: Callable[[], None] = lambda: None
        self.sound_speed_ctd_mps: float | None = None
        self._sonars = {channel: _Sonar(session) for channel, session in sessions.items()}
        self._wall_unix_s = wall_unix_s
        self._sleep = sleep
        self._synchronising: dict[Channel, asyncio.Task[None]] = {}

    async def apply(self, channel: Channel, body: Mapping[str, object]) -> Outcome:
        """Bring a sonar to what is asked; returns once it was read back.

        Requests that arrive while one is under way are carried out together afterwards, the latest values winning, and
        share its outcome. Raises ConfigError for values out of range, CommandError when refused or not carried out.
        """
        asked = check_asked(body)
        sonar = self._sonars[channel]
        if settings_of(sonar.session).is_timing_known:
            # Refused at once where that is already certain, so that a bad request does not spoil a good one.
            plan(merge_asked(sonar.waiting, asked), settings_of(sonar.session))
        sonar.waiting = merge_asked(sonar.waiting, asked)
        if sonar.batch is None or sonar.batch.done():
            sonar.batch = asyncio.create_task(self._next_batch(channel), name=f"sonar-{channel}-settings")
        return await asyncio.shield(sonar.batch)

    async def act(self, channel: Channel, action: str, confirm: bool) -> Outcome:
        """Carry out a named action. Raises ConfigError for an unknown or unconfirmed one, CommandError if it fails."""
        if action not in ACTIONS:
            raise ConfigError(f"action {action!r}: expected one of {', '.join(ACTIONS)}")
        if action in CONFIRMED_ACTIONS and confirm is not True:
            raise ConfigError(f'{action} needs "confirm": true')
        sonar = self._sonars[channel]
        async with sonar.lock:
            try:
                message = await self._act(sonar.session, action)
            except CommandError as error:
                self._conclude(sonar, str(error))
                raise
            self._conclude(sonar, message)
        return Outcome(True, {"action": action}, settings_of(sonar.session).as_read(), message)

    async def synchronise(self, channel: Channel) -> None:
        """Mark the sonar and read everything: at link-up and after the sonar restarted."""
        sonar = self._sonars[channel]
        sonar.unanswered.clear()
        try:
            await sonar.session.set(mark_frame())
            await self._read_back(sonar, (KoggerId.CHART_SETUP,))
        except CommandError as error:
            self._conclude(sonar, str(error))
            return
        for frame_id, version, payload in REFRESH_ROUND:
            if frame_id != KoggerId.CHART_SETUP:
                await self._refresh(sonar, frame_id, version, payload)
        self._note_read(sonar)
        self._conclude(sonar, "settings read")

    def link_came_up(self) -> None:
        """Mark both sonars and read everything, in the background."""
        for channel in self._sonars:
            self._begin_synchronising(channel)

    def sonar_restarted(self, channel: Channel) -> None:
        """Its settings may be other ones now."""
        self._begin_synchronising(channel)

    async def keep_fresh(self, channel: Channel, link_up: Callable[[], bool]) -> None:
        """Re-read one thing after the other at a low rate, mark the sonar when it is not; until cancelled."""
        sonar = self._sonars[channel]
        while True:
            for frame_id, version, payload in REFRESH_ROUND:
                await self._sleep(REFRESH_PAUSE_S)
                if link_up() and sonar.session.alive and (frame_id, version) not in sonar.unanswered:
                    await self._refresh(sonar, frame_id, version, payload)
            # A sonar that is silent, was never read or shows no MARK is tried again, once a round: old firmware relays
            # nothing, and some may never show the MARK.
            lost = sonar.session.marked is False or not settings_of(sonar.session).is_timing_known
            if link_up() and lost:
                await self.synchronise(channel)

    def setting_changed_elsewhere(self, channel: Channel, frame_id: int) -> None:
        """KoggerApp set something: read it back."""
        session = self._sonars[channel].session
        payload = b"\0" if frame_id == KoggerId.DATASET else b""
        for version in DISTANCE_SETUP_VERSIONS if frame_id == KoggerId.DISTANCE_SETUP else (0,):
            session.ask_soon(frame_id, version, payload)

    def took(self, channel: Channel, frame: KoggerFrame) -> None:
        """The session took a frame: what is shown may have changed."""
        if frame.frame_id in READ_IDS and not frame.response:
            self._note_read(self._sonars[channel])

    def state(self) -> dict[str, Any]:
        """The answer of GET /api/sonar."""
        state: dict[str, Any] = {channel.value: self._state(sonar) for channel, sonar in self._sonars.items()}
        state["limits"] = {key: list(limits) for key, limits in LIMITS.items()}
        state["sound_speed_ctd_mps"] = self.sound_speed_ctd_mps
        return state

    async def close(self) -> None:
        """End what is under way."""
        tasks: list[asyncio.Task[Any]] = [sonar.batch for sonar in self._sonars.values() if sonar.batch is not None]
        tasks += self._synchronising.values()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _begin_synchronising(self, channel: Channel, delay_s: float = 0.0) -> None:
        sonar = self._sonars[channel]
        sonar.synchronise_wanted = True
        running = self._synchronising.get(channel)
        if running is None or running.done():
            task = asyncio.create_task(self._synchronise_while_wanted(channel, delay_s))
            self._synchronising[channel] = task

    async def _synchronise_while_wanted(self, channel: Channel, delay_s: float) -> None:
        sonar = self._sonars[channel]
        if delay_s:
            await self._sleep(delay_s)
        while sonar.synchronise_wanted:
            sonar.synchronise_wanted = False
            await self._synchronise_patiently(sonar)

    async def _synchronise_patiently(self, sonar: _Sonar) -> None:
        """At link-up the board or the sonar may still be starting: a first silence is not the last word."""
        for attempt in range(LINK_UP_TRIES):
            if attempt:
                await self._sleep(REFRESH_PAUSE_S)
            await self.synchronise(sonar.session.channel)
            if settings_of(sonar.session).is_timing_known or sonar.synchronise_wanted:
                return

    def _state(self, sonar: _Sonar) -> dict[str, Any]:
        return {
            "asked": dict(sonar.asked),
            "read": settings_of(sonar.session).as_read(),
            "read_at": sonar.read_at_unix_s,
            "alive": sonar.session.alive,
            "pending": sonar.lock.locked(),
            "last_result": sonar.last_result,
            "device": device_of(sonar.session),
        }

    async def _next_batch(self, channel: Channel) -> Outcome:
        sonar = self._sonars[channel]
        async with sonar.lock:
            asked, sonar.waiting, sonar.batch = sonar.waiting, {}, None
            sonar.asked = asked
            self.on_change()
            try:
                outcome = await self._carry_out(sonar, asked)
            except (CommandError, ConfigError) as error:
                self._conclude(sonar, str(error))
                raise
        self._conclude(sonar, outcome.message)
        return outcome

    async def _carry_out(self, sonar: _Sonar, asked: Asked) -> Outcome:
        session = sonar.session
        if not settings_of(session).is_timing_known:
            # The period can only be checked against the range if both are known.
            await self._read_back(sonar, (KoggerId.CHART_SETUP, KoggerId.DATASET))
        refusals = []
        frames = plan(asked, settings_of(session))
        for frame_id, frame in frames:
            code = await session.set(frame)
            session.forget(frame_id)
            # Without a result the read-back decides.
            if code is not None and code != ResultCode.OK:
                refusals.append(f"{frame_id.name.lower()}: {result_meaning(code)}")
        await self._read_back(sonar, tuple(frame_id for frame_id, _ in frames))
        self._note_read(sonar)
        read = settings_of(session).as_read()
        wrong = refusals + differences(asked, read)
        message = "; ".join(wrong) if wrong else "set and read back"
        return Outcome(not wrong, asked, read, message)

    async def _read_back(self, sonar: _Sonar, frame_ids: tuple[KoggerId, ...]) -> None:
        for frame_id in dict.fromkeys(frame_ids):
            await sonar.session.get(frame_id, 0, b"\0" if frame_id == KoggerId.DATASET else b"")

    async def _refresh(self, sonar: _Sonar, frame_id: int, version: int, payload: bytes) -> None:
        try:
            await sonar.session.get(frame_id, version, payload, attempts=1)
        except CommandError as error:
            # Some sonars do not know some of these; asked again when the link or the sonar comes back.
            sonar.unanswered.add((frame_id, version))
            logger.debug("sonar %s: %s", sonar.session.channel, error)
        else:
            sonar.unanswered.discard((frame_id, version))

    async def _act(self, session: SonarSession, action: str) -> str:
        if action == "refresh":
            await self.synchronise(session.channel)
            return "read again"
        frames = {
            "stop": Dataset(0, 0, DatasetMask(0)).set_frame(),
            "save_to_flash": flash_frame(FlashAction.SAVE),
            "reboot": boot_frame(BootAction.REBOOT),
        }
        code = await session.set(frames[action])
        session.forget(KoggerId.DATASET)
        if action == "reboot":
            self._begin_synchronising(session.channel, RESTART_S)
        if code is None and action != "reboot":
            raise CommandError(f"sonar {session.channel} did not confirm: {action} may not have been carried out")
        if code is not None and code != ResultCode.OK:
            raise CommandError(f"sonar {session.channel}: {result_meaning(code)}")
        return {"stop": "stopped", "save_to_flash": "saved", "reboot": "restarting"}[action]

    def _note_read(self, sonar: _Sonar) -> None:
        if settings_of(sonar.session).chart is not None:
            sonar.read_at_unix_s = self._wall_unix_s()
            self.on_change()

    def _conclude(self, sonar: _Sonar, message: str | None) -> None:
        sonar.last_result = message
        self.on_change()


def settings_of(session: SonarSession) -> SonarSettings:
    """The sonar's settings as last read."""
    chart = session.answers(KoggerId.CHART_SETUP)
    datasets = [(Dataset.parse(answer.frame), answer.at_s) for answer in session.answers(KoggerId.DATASET)]
    # The slot that carries the echograms is the one whose period matters; of two answers the later one.
    known = [(dataset, at_s) for dataset, at_s in datasets if dataset is not None]
    latest = max(known, key=lambda told: (bool(told[0].mask & DatasetMask.CHART), told[1]), default=(None, 0.0))
    transceiver = session.answers(KoggerId.TRANSCEIVER)
    speed = session.answers(KoggerId.SOUND_SPEED)
    dsp = session.answers(KoggerId.DSP)
    return SonarSettings(
        chart=ChartSetup.parse(chart[0].frame) if chart else None,
        dataset=latest[0],
        transceiver=Transceiver.parse(transceiver[0].frame) if transceiver else None,
        sound_speed=SoundSpeed.parse(speed[0].frame) if speed else None,
        dsp=Dsp.parse(dsp[0].frame) if dsp else None,
    )


def device_of(session: SonarSession) -> dict[str, Any]:
    """Name, board, firmware and serial number, as far as the sonar told them."""
    device: dict[str, Any] = {"name": None, "board": None, "firmware": None, "serial": None}
    for version in VERSION_VERSIONS:
        for answer in session.answers(KoggerId.VERSION, version):
            told = parse_version(answer.frame)
            if isinstance(told, VersionInfo):
                device.update(name=told.part_number or None, board=told.board_name, serial=str(told.serial_number))
            elif isinstance(told, FirmwareInfo):
                device["firmware"] = "{}.{}".format(*told.firmware_version)
                device["board"] = device["board"] or told.board_name
    return device
