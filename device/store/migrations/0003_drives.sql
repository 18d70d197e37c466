-- A landmarks survey is a drive through a pipe. Everything is written while it goes on, about once a second, so that a power cut
-- loses the last second and no more. A landmark's number is its own within its survey; lengths are metres along the pipe.

CREATE TABLE drives (
    survey_id INTEGER PRIMARY KEY REFERENCES surveys (id) ON DELETE CASCADE,
    settings TEXT NOT NULL,
    summary TEXT NOT NULL DEFAULT '{}',
    rings TEXT NOT NULL DEFAULT '[]'
);

CREATE TABLE landmarks (
    survey_id INTEGER NOT NULL REFERENCES drives (survey_id) ON DELETE CASCADE,
    number INTEGER NOT NULL,
    measured TEXT NOT NULL,
    thumbnail BLOB,
    PRIMARY KEY (survey_id, number)
);

-- Who said what of a landmark, never overwritten: the last word on a field counts.
CREATE TABLE landmark_words (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    survey_id INTEGER NOT NULL,
    number INTEGER NOT NULL,
    said TEXT NOT NULL,
    by_whom TEXT NOT NULL,
    created_ms INTEGER,
    clock_source TEXT NOT NULL,
    FOREIGN KEY (survey_id, number) REFERENCES landmarks (survey_id, number) ON DELETE CASCADE
);
CREATE INDEX landmark_words_by_landmark ON landmark_words (survey_id, number);

CREATE TABLE drive_faults (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    survey_id INTEGER NOT NULL REFERENCES drives (survey_id) ON DELETE CASCADE,
    body TEXT NOT NULL
);
CREATE INDEX drive_faults_by_survey ON drive_faults (survey_id);

-- Frames and detections of a second each, as compressed JSON: enough to map and to smooth the drive again.
CREATE TABLE drive_log (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    survey_id INTEGER NOT NULL REFERENCES drives (survey_id) ON DELETE CASCADE,
    chunk BLOB NOT NULL
);
CREATE INDEX drive_log_by_survey ON drive_log (survey_id);

-- What is set from the page and outlives a restart: one JSON object a name.
CREATE TABLE kept (
    name TEXT PRIMARY KEY,
    body TEXT NOT NULL
);
