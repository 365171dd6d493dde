"""The transmitter's message: where the buoy is and when it sent, over the pulse train itself."""
