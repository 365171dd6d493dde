"""The UDP port of the acoustic board: its datagrams become records on the hub, live and in a replay alike."""

from __future__ import annotations

from collections.abc import Callable

from bluerov_slam.pipeline.acoustic_frames import AcousticInput
from bluerov_slam.records import AcousticBytes, Record
from bluerov_slam.services.hub import Hub
from bluerov_slam.sources.udp import Address, UdpSource, open_udp_source


class AcousticsInput:
    """`listen` opens and closes the port; `take` is for datagrams that a recording brings."""

    def __init__(self, hub: Hub, now_s: Callable[[], float]) -> None:
        self._hub = hub
        self._now_s = now_s
        self._decoder = AcousticInput()
        self._source: UdpSource | None = None
        self._address: Address | None = None

    @property
    def port(self) -> int | None:
        """The port that is open."""
        return self._source.port if self._source is not None else None

    @property
    def sources(self) -> tuple[str, ...]:
        """Who has been heard."""
        return self._decoder.sources

    async def listen(self, address: Address | None) -> None:
        """Open this port and no other, None: none. Raises LinkError naming the setting when it is taken."""
        if address == self._address:
            return
        self._close()
        if address is not None:
            self._source = await open_udp_source(*address, self._on_datagram, "acoustics.udp_port")
            self._address = address

    def stop(self) -> None:
        """Close the port and give out what is left."""
        self._close()
        self._publish(self._decoder.finish())

    def tick(self) -> None:
        """Once a second: records that are overdue."""
        self._publish(self._decoder.flush(self._now_s()))

    def take(self, datagram: AcousticBytes) -> None:
        """A datagram, of the port or of a recording."""
        self._hub.publish(datagram)
        self._publish(self._decoder.feed(datagram.data, datagram.source, datagram.arrived_s))

    def counters(self) -> dict[str, float]:
        """For Prometheus: what only grows."""
        counters = self._decoder.counters
        udp = self._source.counters if self._source is not None else None
        return {
            "acoustics_datagrams": udp.datagrams if udp is not None else 0,
            "acoustics_oversized": udp.oversized if udp is not None else 0,
            "acoustics_frames": counters.frames.total(),
            "acoustics_refused": counters.refused.total(),
            "acoustics_malformed": counters.malformed.total(),
            "acoustics_checksum_errors": counters.checksum_errors,
            "acoustics_crowded_out": counters.crowded_out,
        }

    def _on_datagram(self, data: bytes, address: Address) -> None:
        self.take(AcousticBytes(data, self._now_s(), f"{address[0]}:{address[1]}"))

    def _publish(self, records: list[Record]) -> None:
        for record in records:
            self._hub.publish(record)

    def _close(self) -> None:
        if self._source is not None:
            self._source.close()
        self._source = self._address = None
