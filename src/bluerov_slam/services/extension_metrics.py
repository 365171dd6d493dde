"""The extension's counters for Prometheus, collected only when somebody asks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

_LINK = ("bytes", "frames", "crc_errors", "length_errors", "bytes_skipped", "resyncs", "unknown_types", "reconnects")
_SONAR = ("pings", "bytes", "frames", "checksum_errors", "incomplete", "gaps_samples", "dropped_by_firmware")
_PREFIX = "bluerov_slam"


class StatusCollector(Collector):
    """Turns the status topic's object into metrics, so that the page and Prometheus cannot disagree."""

    def __init__(
        self,
        status: Callable[[], dict[str, Any]],
        extra: Callable[[], dict[str, float]],
        gauges: Callable[[], dict[str, float]] = dict,
    ) -> None:
        self._status = status
        self._extra = extra
        self._gauges = gauges

    def collect(self) -> Iterator[Metric]:
        status = self._status()
        link, recorder, mavlink = status["link"], status["recorder"], status["mavlink"]
        yield _gauge("link_connected", "1 while the serial port is open", link["connected"])
        yield _gauge("link_load_percent", "How full the serial link is", link["load_percent"])
        for key in _LINK:
            yield _counter(f"link_{key}", f"Serial link: {key.replace('_', ' ')}", link[key])
        yield _by_label("link_frames_by_type", "Frames by AA55 type", "type", link["frames_by_type"])
        for key in _SONAR:
            values = {name: sonar[key] for name, sonar in status["sonars"].items() if sonar[key] is not None}
            yield _by_label(f"sonar_{key}", f"Sonar: {key.replace('_', ' ')}", "sonar", values)
        yield _gauge("recorder_queue", "Records waiting for the disk", recorder["queue"])
        yield _counter("recorder_dropped", "Records lost because the disk was too slow", recorder["dropped"])
        if recorder["free_bytes"] is not None:
            yield _gauge("recorder_free_bytes", "Free space for recordings", recorder["free_bytes"])
        yield _counter("mavlink_sent", "MAVLink messages sent", mavlink["sent"])
        yield _counter("mavlink_received", "MAVLink messages received", mavlink["received"])
        yield _gauge("clients", "WebSocket clients", status["clients"])
        yield _gauge("faults", "Faults shown now", len(status["faults"]))
        yield from _forwarding(status["forwarding"])
        for name, value in self._extra().items():
            yield _counter(name, name.replace("_", " "), value)
        for name, value in self._gauges().items():
            yield _gauge(name, name.replace("_", " "), value)


def metrics_page(collector: Collector) -> Callable[[], bytes]:
    """A function that renders the metrics; with a registry of its own, so that tests can run several services."""
    registry = CollectorRegistry()
    registry.register(collector)
    return lambda: generate_latest(registry)


def _forwarding(targets: list[dict[str, Any]]) -> Iterator[Metric]:
    for key in ("frames", "bytes", "errors"):
        family = CounterMetricFamily(f"{_PREFIX}_forwarding_{key}", f"UDP: {key}", labels=["target", "sonar"])
        for target in targets:
            family.add_metric([target["target"], target["channel"]], target[key])
        yield family


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f"{_PREFIX}_{name}", text, value=float(value))


def _counter(name: str, text: str, value: float) -> Metric:
    return CounterMetricFamily(f"{_PREFIX}_{name}", text, value=float(value))


def _by_label(name: str, text: str, label: str, values: dict[str, float]) -> Metric:
    family = CounterMetricFamily(f"{_PREFIX}_{name}", text, labels=[label])
    for key, value in values.items():
        family.add_metric([key], value)
    return family
