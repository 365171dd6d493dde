"""Attitude from inertial and magnetic samples, and what the sensors need to be told about themselves first."""
