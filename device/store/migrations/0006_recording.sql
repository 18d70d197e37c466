-- What became of the raw data of a survey, as JSON: {"state", "message", "dropped", ...}; null where nobody has tried to record it.
ALTER TABLE surveys ADD COLUMN recording TEXT;
