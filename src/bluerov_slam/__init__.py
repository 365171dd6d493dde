"""BlueROV SLAM: localization and side-scan sonar imaging for the BlueROV2."""

__version__ = "0.1.0"
