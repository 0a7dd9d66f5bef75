"""Calibration of inertial sensors and magnetometers from their own samples: fits, live sessions, exports."""
