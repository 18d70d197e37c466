-- What the box did and what befell it, so that whoever comes can read what happened while nobody looked. at_ns is the moment that
-- a row is about, monotonic and comparable within one boot_id only; at_ms the same in milliseconds since 1970, null while the box
-- did not know the date.
CREATE TABLE journal (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    what TEXT NOT NULL,
    survey_id INTEGER REFERENCES surveys (id) ON DELETE SET NULL,
    reason TEXT NOT NULL DEFAULT '',
    boot_id TEXT NOT NULL,
    at_ns INTEGER NOT NULL,
    at_ms INTEGER,
    clock_source TEXT NOT NULL
);
CREATE INDEX journal_by_survey ON journal (survey_id);
