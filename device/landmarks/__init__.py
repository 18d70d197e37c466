"""The landmarks survey of the box: the crawler that it drives, its detectors, its command, its pictures."""
