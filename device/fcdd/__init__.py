"""The FCDD network: what it learns from, how it is trained and exported, and how it looks at a picture."""
