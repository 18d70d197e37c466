"""The anomaly survey of the box: its stereo rig and calibration, its desk, its command, its pictures."""
