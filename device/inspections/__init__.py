"""What the utility takes home: sites, inspections and their coded observations, ready to be exported."""
