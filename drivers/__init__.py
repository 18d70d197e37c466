"""What the box is plugged into: sensors and their virtual twins. Knows hardware and bytes, never a survey."""
