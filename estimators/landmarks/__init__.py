"""Landmarks of a pipe from detections and the tether: projection, filter, association, tracks, smoothing (the CCTV paper)."""
