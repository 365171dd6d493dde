import json

import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.services import settings_store
from bluerov_slam.services.settings_store import SettingsStore


@pytest.fixture
def open_store(tmp_path):
    def _open(config="", flags=None, environment=None):
        file = tmp_path / "dive.toml"
        file.write_text(config)
        return SettingsStore.open(file, {"paths.state": str(tmp_path / "state"), **(flags or {})}, environment or {})

    return _open


def saved(tmp_path):
    return json.loads((tmp_path / "state" / "settings.json").read_text())


def write(tmp_path, text):
    (tmp_path / "state").mkdir(exist_ok=True)
    (tmp_path / "state" / "settings.json").write_text(text)


def listed(store, key):
    return next(entry for entry in store.listing()["settings"] if entry["key"] == key)


def test_a_change_is_in_force_at_once_and_after_a_restart(open_store, tmp_path):
    store = open_store()
    assert store.change({"sonar.swap_a_b": True, "forwarding.targets": ["127.0.0.1", "boat"]}) == {
        "sonar.swap_a_b",
        "forwarding.targets",
    }
    assert store.settings.sonar.swap_a_b is True
    again = open_store()
    assert again.settings.forwarding.targets == ("127.0.0.1", "boat")
    assert saved(tmp_path)["version"] == 1


def test_a_change_is_all_or_nothing(open_store, tmp_path):
    store = open_store()
    with pytest.raises(
        ConfigError, match=r"the page: recording.max_file_mb = 0: expected a whole number from 1 to 4096"
    ):
        store.change({"sonar.swap_a_b": True, "recording.max_file_mb": 0})
    assert store.settings.sonar.swap_a_b is False
    assert not (tmp_path / "state" / "settings.json").exists()
    with pytest.raises(ConfigError, match="unknown setting"):
        store.change({"sonar.swap": True})


def test_a_secret_sent_back_as_it_is_shown_stays_what_it_is(open_store):
    store = open_store()
    store.change({"http.token": "s3cret"})
    shown = listed(store, "http.token")["value"]
    assert store.change({"http.token": shown, "display.units": "imperial"}) == {"display.units"}
    assert store.settings.http.token == "s3cret"


def test_a_restored_backup_leaves_the_secrets_alone(open_store):
    store = open_store()
    store.change({"http.token": "s3cret", "display.units": "imperial"})
    backup = store.backup()
    store.change({"display.units": "metric"})
    assert store.restore(backup) == {"display.units"}
    assert store.settings.http.token == "s3cret"


def test_null_takes_a_setting_back(open_store):
    store = open_store('[display]\nunits = "imperial"\n')
    store.change({"display.units": "metric"})
    assert store.change({"display.units": None}) == {"display.units"}
    assert store.settings.display.units == "imperial"


def test_the_page_overrules_the_file_but_not_environment_or_flag(open_store):
    store = open_store(
        "[serial]\nbaud = 115200\n", flags={"http.port": 9000}, environment={"BLUEROV_SLAM_SERIAL__PORT": "/dev/x"}
    )
    store.change({"serial.baud": 921600})
    assert store.settings.serial.baud == 921600
    with pytest.raises(ConfigError, match=r"serial.port is set by environment; change it there"):
        store.change({"serial.port": "/dev/y"})
    with pytest.raises(ConfigError, match=r"http.port is set by command line"):
        store.change({"http.port": 1})
    assert listed(store, "http.port")["fixed_by"] == "command line"
    assert listed(store, "serial.baud")["fixed_by"] is None


def test_the_state_folder_cannot_be_changed_from_inside_it(open_store):
    with pytest.raises(ConfigError, match=r"paths.state is set by configuration file, environment or command line"):
        open_store().change({"paths.state": "/elsewhere"})


def test_the_listing_says_what_waits_for_a_restart(open_store):
    store = open_store()
    store.change({"viewer.history_mb": 32, "sonar.mirror": True})
    assert listed(store, "viewer.history_mb")["pending"] is True
    assert listed(store, "sonar.mirror")["pending"] is False
    entry = listed(store, "recording.max_file_mb")
    assert (entry["minimum"], entry["maximum"], entry["unit"], entry["default"]) == (1, 4096, "MB", 256)
    assert listed(store, "serial.baud")["choices"] == (115200, 921600)


def test_secrets_are_neither_shown_nor_backed_up(open_store):
    store = open_store()
    store.change({"http.token": "s3cret", "sonar.mirror": True})
    assert "s3cret" not in json.dumps(store.listing())
    assert store.backup() == {"version": 1, "settings": {"sonar.mirror": True}}


def test_a_backup_restores_the_very_settings(open_store):
    store = open_store()
    store.change({"sonar.mirror": True, "mavlink.system_id": 3})
    backup = store.backup()
    store.change({"sonar.mirror": None, "mavlink.system_id": 9, "display.theme": "dark"})
    assert store.restore(backup) == {"sonar.mirror", "mavlink.system_id", "display.theme"}
    assert store.backup() == backup


@pytest.mark.parametrize(
    ("data", "text"),
    [
        ({"version": 2, "settings": {}}, "version 2 of the settings is not known here"),
        ({"version": "x"}, "version 'x'"),
        ({"version": 1}, 'lack the object "settings"'),
        ({"version": 1, "settings": {"sonar.mirror": 3}}, "sonar.mirror = 3: expected true or false"),
        ({"nonsense": {"key": 1}}, "nonsense.key: unknown setting"),
    ],
)
def test_a_backup_that_does_not_fit_changes_nothing(open_store, data, text):
    store = open_store()
    store.change({"display.theme": "dark"})
    with pytest.raises(ConfigError, match=text):
        store.restore(data)
    assert store.settings.display.theme == "dark"


def test_a_file_of_before_versions_is_migrated(open_store, tmp_path):
    write(tmp_path, '{"sonar": {"swap_a_b": true}, "mavlink": {"system_id": 4}}')
    store = open_store()
    assert store.notices == []
    assert (store.settings.sonar.swap_a_b, store.settings.mavlink.system_id) == (True, 4)
    store.change({"display.theme": "dark"})
    assert saved(tmp_path) == {
        "version": 1,
        "settings": {"sonar.swap_a_b": True, "mavlink.system_id": 4, "display.theme": "dark"},
    }


@pytest.mark.parametrize("text", ["{cut", "[]", "", '{"version": 1}', '{"version": 99, "settings": {}}', "\x00\x00"])
def test_a_damaged_file_is_set_aside_with_a_notice_and_defaults_apply(open_store, tmp_path, text):
    write(tmp_path, text)
    store = open_store()
    assert store.settings.sonar.swap_a_b is False
    [notice] = store.notices
    assert "settings.json" in notice
    assert "kept as settings.json.damaged" in notice
    assert (tmp_path / "state" / "settings.json.damaged").read_text() == text


def test_a_value_that_no_longer_fits_is_dropped_alone_with_a_notice(open_store, tmp_path):
    write(tmp_path, '{"version": 1, "settings": {"sonar.mirror": true, "sonar.gone": 1, "serial.baud": 9600}}')
    store = open_store()
    assert store.settings.sonar.mirror is True
    assert store.settings.serial.baud == 115200
    assert len(store.notices) == 2
    assert all("this setting is ignored" in notice for notice in store.notices)


def test_a_wrong_value_in_the_users_own_file_stops_the_start(open_store):
    with pytest.raises(ConfigError, match=r"dive.toml: serial.baud = 9600: expected one of 115200, 921600"):
        open_store("[serial]\nbaud = 9600\n")


def test_a_folder_that_cannot_be_written_is_named_and_nothing_changes(open_store, tmp_path):
    (tmp_path / "state").write_text("a file where the folder should be")
    store = open_store()
    with pytest.raises(ConfigError, match=r"the settings cannot be saved in .*settings.json"):
        store.change({"sonar.mirror": True})
    assert store.settings.sonar.mirror is False


def test_a_power_cut_while_writing_leaves_the_old_file(open_store, tmp_path, monkeypatch):
    store = open_store()
    store.change({"sonar.mirror": True})
    before = saved(tmp_path)

    def cut(_descriptor):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(settings_store.os, "fsync", cut)
    with pytest.raises(ConfigError, match="Input/output error"):
        store.change({"sonar.mirror": False})
    assert saved(tmp_path) == before
