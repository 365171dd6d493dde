"""A Kogger sonar behind the viewer link, as far as its settings go; stands in for extension, ESP32 and sonar in one."""

from bluerov_slam.protocol.kogger import (
    ChartSetup,
    Dataset,
    DatasetMask,
    Dsp,
    FirmwareInfo,
    FrameType,
    KoggerFrame,
    KoggerFrameDecoder,
    KoggerId,
    ResultCode,
    SoundSpeed,
    Transceiver,
    VersionInfo,
    parse_setting,
    result_frame,
    version_content_frame,
)
from bluerov_slam.records import Channel
from bluerov_slam.services.sonar_session import SonarSession
from bluerov_slam.services.viewer_link_client import CommandResult


def parse(data: bytes) -> list[KoggerFrame]:
    return KoggerFrameDecoder("mod256").feed(data)


class FakeSonar:
    def __init__(self, channel: Channel = Channel.A) -> None:
        self.session = SonarSession(channel, self, answer_timeout_s=0.01)
        self.heard: list[KoggerFrame] = []
        self.settings = {
            KoggerId.CHART_SETUP: ChartSetup(1000, 20, 0),
            KoggerId.DATASET: Dataset(1, 100, DatasetMask.CHART | DatasetMask.TEMPERATURE),
            KoggerId.TRANSCEIVER: Transceiver(455, 10, True),
            KoggerId.SOUND_SPEED: SoundSpeed(1500.0),
            KoggerId.DSP: Dsp(0),
        }
        self.link_results: list[str] = []
        self.answers_lost = 0
        self.gives_results = True
        self.result = ResultCode.OK
        self.stubborn = False
        self.before_answer = lambda: None

    async def command(self, channel: Channel, frame: bytes) -> CommandResult:
        link = self.link_results.pop(0) if self.link_results else "ok"
        if link != "ok":
            return CommandResult(link)
        (request,) = parse(frame)
        self.heard.append(request)
        self.before_answer()
        if self.answers_lost:
            self.answers_lost -= 1
            return CommandResult("ok")
        for answer in self._answer(request):
            self.session.heard(mark=True)
            self.session.take(parse(answer)[0])
        return CommandResult("ok")

    def sent(self, frame_type: FrameType) -> list[int]:
        return [frame.frame_id for frame in self.heard if frame.frame_type == frame_type]

    def _answer(self, request: KoggerFrame) -> list[bytes]:
        if request.frame_type == FrameType.SETTING:
            setting = parse_setting(request)
            if setting is not None and self.result == ResultCode.OK and not self.stubborn:
                self.settings[setting.frame_id] = setting
            return [result_frame(request, self.result)] if self.gives_results else []
        if request.frame_id == KoggerId.VERSION:
            info = {
                0: VersionInfo(8, 1, (1, 2), 4711, "SSS-A"),
                2: FirmwareInfo(False, 8, 1, (1, 2), (0, 87)),
            }.get(request.version)
            return [version_content_frame(info)] if info else []
        setting = self.settings.get(KoggerId(request.frame_id))
        return [setting.content_frame()] if setting is not None and request.version == 0 else []
