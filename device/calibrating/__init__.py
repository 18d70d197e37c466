"""``borescout calibrate``: what a stereo rig is told before it measures, by a pipe of known size or by a board."""
