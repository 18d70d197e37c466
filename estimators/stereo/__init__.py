"""Stereo matching for a camera that looks along a pipe: the paper's way, and the way that follows the wall."""
