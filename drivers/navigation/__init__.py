"""What tells a vehicle where it is: DVL, pressure sensor, AHRS, and the scans it takes on its way."""
