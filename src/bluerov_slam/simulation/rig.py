"""A simulated rig: four platforms that were made and mounted a little otherwise than drawn, with servos that play.

It takes counts as the servo drivers do. What each servo makes of them, the forward kinematics of the platforms as they
really are turn into the tool's true pose. Faults are those that a servo has: it does not move any more, or it sits on
its spline a tooth off. All figures are the simulator's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import ConfigError
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_SERVOS, LEGS, ServoCalibration, StackDimensions
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.servos import angles_of, counts_of
from bluerov_slam.rig.stack import StackPose, stack_pose

Array = NDArray[np.float64]

FAULT_KINDS = ("stuck", "offset")


@dataclass(frozen=True, slots=True)
class RigFigures:
    """Standard deviations of one rig, drawn once for each part; `slop_rad` anew at each place of a servo.

    `gain` is that of all servos together (their pulse does not mean quite the angle it should), `own_gain` of each.
    Servos turn at `speed_radps` under load.
    """

    servo_rad: float = math.radians(0.7)
    slop_rad: float = math.radians(0.25)
    gain: float = 0.06
    own_gain: float = 0.02
    rod_mm: float = 0.25
    arm_mm: float = 0.15
    joint_mm: float = 0.20
    stacking_mm: float = 0.30
    speed_radps: float = 5.0


@dataclass(frozen=True, slots=True)
class ServoFault:
    """A servo that is "stuck" where it was at first, or "offset" by an angle. Counted from 0, base to top."""

    kind: str
    platform: int
    servo: int
    angle_rad: float = 0.0

    @classmethod
    def parse(cls, text: str) -> ServoFault:
        """Of "stuck 1 4" or "offset 2 0 14.4" (platform, servo, degrees). Raises ConfigError."""
        kind, *numbers = text.split() or [""]
        try:
            platform, servo = int(numbers[0]), int(numbers[1])
            angle = math.radians(float(numbers[2])) if len(numbers) > 2 else 0.0
        except (IndexError, ValueError):
            kind, platform, servo, angle = "", -1, -1, 0.0
        wanted = {"stuck": 2, "offset": 3}.get(kind)
        whole_turn = abs(angle) <= math.pi  # NaN is not within it
        if wanted != len(numbers) or not 0 <= platform < 4 or not 0 <= servo < LEGS or not whole_turn:
            raise ConfigError(
                f"'{text}' is no fault of a servo; expected 'stuck PLATFORM SERVO' or 'offset PLATFORM SERVO DEGREES', "
                f"platforms 0 to 3 from the base, servos 0 to {LEGS - 1}, degrees -180 to 180"
            )
        return cls(kind, platform, servo, angle)


@dataclass(frozen=True, eq=False)
class Track:
    """Where the tool went: instants (n,) s from the start of the move, places (n, 3) mm in the rig frame."""

    times_s: Array
    places_mm: Array


class SimulatedRig:
    """One rig by its seed. Starts at home with power on."""

    def __init__(
        self,
        seed: int,
        figures: RigFigures | None = None,
        faults: Sequence[ServoFault] = (),
        dimensions: StackDimensions = FO_SHIP,
        servos: ServoCalibration = FO_SHIP_SERVOS,
    ) -> None:
        self._figures = drawn = figures or RigFigures()
        self._faults = faults
        self._servos = servos
        self._drawn = dimensions
        self._random = random = np.random.default_rng([seed, 0x416])
        count = len(dimensions.platforms)

        def around(values: Array, deviation: float) -> Array:
            return values + deviation * random.standard_normal(np.shape(values))

        platforms = tuple(
            replace(
                platform,
                base_joints_mm=around(platform.base_joints_mm, drawn.joint_mm),
                plate_joints_mm=around(platform.plate_joints_mm, drawn.joint_mm),
                arm_mm=around(platform.arm_mm, drawn.arm_mm),
                rod_mm=around(platform.rod_mm, drawn.rod_mm),
            )
            for platform in dimensions.platforms
        )
        self.dimensions = StackDimensions(
            platforms,
            around(dimensions.foot_mm, drawn.stacking_mm),
            around(dimensions.base_mm, drawn.stacking_mm),
            around(dimensions.tool_mm, drawn.stacking_mm),
        )
        self._zero_rad = around(np.zeros((count, LEGS)), drawn.servo_rad)
        self._gain = (1.0 + drawn.gain * random.standard_normal()) * around(np.ones((count, LEGS)), drawn.own_gain)
        self._counts = self.counts_for(np.zeros((count, 6)))
        self._stuck_rad = angles_of(self._counts, servos)
        self._points = np.zeros((count, 6))
        self._settle()

    @property
    def pose(self) -> StackPose:
        """The tool's true pose."""
        return self._pose

    @property
    def true_set_points(self) -> Array:
        """What every platform really stands at, (platforms, 6)."""
        return self._points.copy()

    def counts_for(self, set_points: Array) -> Array:
        """What the firmware sends the servos for set points (platforms, 6); NaN where it must not move."""
        pairs = zip(set_points, self._drawn.platforms, strict=True)
        angles = np.array([servo_angles_rad(point, platform) for point, platform in pairs])
        return counts_of(angles, self._servos)

    def move(self, start: Array, end: Array, steps: int, step_s: float) -> Track | None:
        """All platforms from set points to others (platforms, 6) in straight steps; None: refused, nothing moved."""
        shares = np.arange(1, steps + 1) / steps
        ways = [self.counts_for(start + share * (end - start)) for share in shares]
        if not np.isfinite(ways).all():
            return None
        from_mm = self._pose.position_mm
        turned = np.abs(angles_of(ways[-1], self._servos) - angles_of(self._counts, self._servos)).max() / steps
        self._counts = ways[-1]
        self._settle()
        # Each step is a jump of the servos at their own speed and a wait for the next.
        busy_s = min(turned / self._figures.speed_radps, step_s)
        begins = step_s * np.arange(steps)
        times = np.stack([begins, begins + max(busy_s, 1e-3)], axis=1).ravel()
        went = np.stack([shares - 1.0 / steps, shares], axis=1).ravel()
        return Track(times, from_mm + went[:, None] * (self._pose.position_mm - from_mm))

    def _settle(self) -> None:
        """Every servo to what it makes of its counts, and the platforms with them."""
        told = angles_of(self._counts, self._servos)
        play = self._figures.slop_rad * self._random.standard_normal(told.shape)
        angles = self._gain * told + self._zero_rad + play
        for fault in self._faults:
            where = fault.platform, fault.servo
            angles[where] = self._stuck_rad[where] if fault.kind == "stuck" else angles[where] + fault.angle_rad
        found = []
        for k, platform in enumerate(self.dimensions.platforms):
            plate = plate_pose(angles[k], platform, self._points[k])
            # Servos that would tear the legs apart stall: the plate stays where it was.
            found.append(plate.set_point if bool(plate.converged) else self._points[k])
        self._points = np.array(found)
        self._pose = stack_pose(self._points, self.dimensions)
