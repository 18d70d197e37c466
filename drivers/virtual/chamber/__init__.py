"""The virtual chamber: a pipe structure in a flooded tank, a scanner that moves around it, and what its sensors say."""
