"""What the operator sees: pages, JSON API and live events in front of one `device.daemon.Device`."""
