"""How the box itself is: read, judged, told."""
