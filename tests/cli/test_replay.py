import json

import pytest

from bluerov_slam.cli.replay import replay_flags
from bluerov_slam.services.settings_store import SettingsStore


@pytest.mark.parametrize(("asked", "enabled"), [((), False), (("mavlink.enabled=true",), True)])
def test_a_replay_sends_no_mavlink_unless_a_flag_asks_for_it(tmp_path, asked, enabled):
    saved = {"version": 1, "settings": {"mavlink.enabled": True}}
    (tmp_path / "settings.json").write_text(json.dumps(saved))
    store = SettingsStore.open(None, replay_flags((f"paths.state={tmp_path}", *asked)), {})
    assert store.settings.mavlink.enabled is enabled
