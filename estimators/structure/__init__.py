"""From scans of a pipe structure and navigation to a semantic map: the method of Vallicrosa et al., Sensors 2021, 21, 6740."""
