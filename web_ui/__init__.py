"""What the operator sees. Asks ``device`` through one facade and holds no logic of its own."""
