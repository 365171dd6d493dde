"""Displacement from an inertial sensor alone: the method of the iSBL thesis as a baseline, and the corrected one.

Good for moves of about a second between rests. Under way at sea nothing tells the velocity's drift; there the vehicle
model and the fixes carry the position (`vehicle_model`, `ekf`).
"""
