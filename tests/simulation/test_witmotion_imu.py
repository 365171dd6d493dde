from bluerov_slam.simulation.witmotion_imu import ImuSettings, WitMotionImu

UNLOCK, SAVE = bytes.fromhex("ff aa 69 88 b5"), bytes.fromhex("ff aa 00 00 00")
RATE_20_HZ, ANGLES_ONLY = bytes.fromhex("ff aa 03 07 00"), bytes.fromhex("ff aa 02 08 00")


def test_obeys_rate_and_outputs_behind_an_unlock() -> None:
    imu = WitMotionImu()
    imu.receive(RATE_20_HZ, 0.0)
    assert imu.settings == ImuSettings()
    for command in (UNLOCK, RATE_20_HZ, ANGLES_ONLY):
        imu.receive(command, 0.0)
    assert imu.settings == ImuSettings(outputs=0b1000, rate_hz=20.0)


def test_locks_itself_after_ten_seconds() -> None:
    imu = WitMotionImu()
    imu.receive(UNLOCK, 0.0)
    imu.receive(RATE_20_HZ, 10.0)
    assert imu.settings == ImuSettings()


def test_takes_commands_cut_anywhere_and_finds_them_in_noise() -> None:
    imu = WitMotionImu()
    stream = b"\x00\xff" + UNLOCK + b"\xaa" + RATE_20_HZ
    for index in range(len(stream)):
        imu.receive(stream[index : index + 1], 0.0)
    assert imu.settings.rate_hz == 20.0


def test_forgets_without_power_what_was_not_saved() -> None:
    imu = WitMotionImu()
    imu.receive(UNLOCK + ANGLES_ONLY + SAVE + RATE_20_HZ, 0.0)
    imu.power_up()
    assert imu.settings == ImuSettings(outputs=0b1000)
