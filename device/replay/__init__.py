"""Recorded surveys computed again and compared with what they found."""
