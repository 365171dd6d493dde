import subprocess
import sys
from pathlib import Path

from free_ports import free_port

CLAIM = "import sys; from free_ports import _claim; print(_claim(int(sys.argv[1])))"


def test_a_port_is_given_once_and_no_other_process_can_claim_it():
    ports = [free_port() for _ in range(30)]
    assert len(set(ports)) == 30
    for port, answer in ((ports[0], "False"), (1, "True")):
        told = subprocess.run(
            (sys.executable, "-c", CLAIM, str(port)), cwd=Path(__file__).parent, capture_output=True, text=True
        )
        assert told.stdout.strip() == answer, told.stderr


def test_the_kernel_gives_none_of_these_ports_to_a_connection():
    low, high = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    if high - low < 40_000:  # otherwise there are too few others
        assert not any(low <= free_port() <= high for _ in range(30))
