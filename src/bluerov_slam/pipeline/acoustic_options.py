"""What the acoustic pipeline must know that no sensor tells it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses


@dataclass(frozen=True)
class AcousticOptions:
    """`beacon_deg` is the transmitter's latitude and longitude, None where it is not known.

    `sound_speed_mps` is used where the CTD tells none, or always with `sound_speed_fixed`. `delay_std_s` is the error
    of a delay that the board measured itself (one sigma), `slip_prior` how often one of its receivers is wrong by a
    period of the carrier; `nearest_m`: the transmitter is hardly ever nearer. `use_for_navigation`: the navigator takes
    the delays.
    """

    array: ReceiverArray = field(default_factory=ReceiverArray.cross)
    mounting: ArrayMounting = field(default_factory=ArrayMounting)
    responses: ReceiverResponses | None = None  # of the receivers, where a calibration knows them
    sound_speed_mps: float = 1500.0
    sound_speed_fixed: bool = False
    beacon_deg: tuple[float, float] | None = None
    beacon_depth_m: float | None = None
    beacon_std_m: float = 1.0
    beacon_depth_std_m: float = 0.3  # on a line it hangs and swings
    beacon_from_message: bool = True
    carrier_hz: float = 40_000.0
    delay_std_s: float = 0.5e-6
    place_std_m: float = 1e-3  # [choice] of a receiver's place along any axis, measured with a ruler
    slip_prior: float = 0.01
    nearest_m: float = 3.0
    use_for_navigation: bool = True
    # What the filter holds of a pulse and of the array; sources as in `navigator_options`.
    direction_std_rad: float = math.radians(3.0)  # [survey] 3.2 deg with five hydrophones in water; learned from there
    outlier_share: float = 0.05  # [choice] pulses that come by an echo alone
    mounting_std_rad: float = math.radians(2.0)  # [choice] screwed to a frame by hand, and the frame to the vehicle
    # [thesis] the directions of eighteen sessions are off by 0.47 deg rms per axis, constant for their ten minutes
    # (Frabosilio 2024, mean errors of the raw fixes over the range).
    wander_std_rad: float = math.radians(0.5)
    # [choice] as that of a compass: refraction and overlapping echoes change with the place.
    wander_time_s: float = 300.0
    sound_speed_std: float = 2e-3  # [choice] 3 m/s, with a CTD on board
