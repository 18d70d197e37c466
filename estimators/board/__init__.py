"""Two plain cameras calibrated by views of a board: what is seen of it, what the views cover, lenses, how well known."""
