"""What the box computes: pure functions on numpy arrays. No clock, thread, file, socket or configuration object in here."""
