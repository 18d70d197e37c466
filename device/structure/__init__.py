"""The structure survey of the box: what it listens to, its desk for the page and the API, its command, its files."""
