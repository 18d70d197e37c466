"""Training of the FCDD network on a processor (dependency group ``train``). Arrays in, weights and scores out."""
