"""Findings of the anomaly survey: how far the wall lies from the shape it should have, as maps, scores and regions."""
