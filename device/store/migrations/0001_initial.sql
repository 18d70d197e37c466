-- Sites hold nodes, pipes join nodes, surveys look at pipes, recordings belong to surveys, findings hang on both.
-- Times are milliseconds since 1970 and null while the box did not know the date; monotonic_ns can be compared within one boot_id only.

CREATE TABLE sites (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
);
INSERT INTO sites (id, name) VALUES (1, 'Site');

CREATE TABLE nodes (
    id INTEGER PRIMARY KEY,
    site_id INTEGER NOT NULL REFERENCES sites (id),
    name TEXT NOT NULL,
    UNIQUE (site_id, name)
);

CREATE TABLE pipes (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    name TEXT NOT NULL,
    start_node INTEGER REFERENCES nodes (id),
    end_node INTEGER REFERENCES nodes (id),
    material TEXT NOT NULL,
    shape TEXT NOT NULL,
    reference_dn INTEGER,
    note TEXT NOT NULL DEFAULT '',
    deleted INTEGER NOT NULL DEFAULT 0
);

-- AUTOINCREMENT: the number of a purged survey is never given to another one, it may stand in somebody's notes.
CREATE TABLE surveys (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    kind TEXT NOT NULL,
    pipe_id INTEGER REFERENCES pipes (id),
    state TEXT NOT NULL,
    created_ms INTEGER,
    clock_source TEXT NOT NULL,
    boot_id TEXT NOT NULL,
    monotonic_ns INTEGER NOT NULL,
    deleted INTEGER NOT NULL DEFAULT 0,
    deleted_ms INTEGER
);
CREATE INDEX surveys_by_pipe ON surveys (pipe_id, id);

CREATE TABLE recordings (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    survey_id INTEGER NOT NULL REFERENCES surveys (id) ON DELETE CASCADE,
    camera TEXT NOT NULL,
    position TEXT,
    frames INTEGER NOT NULL,
    settings TEXT NOT NULL DEFAULT '{}'
);
CREATE INDEX recordings_by_survey ON recordings (survey_id);

-- A finding without a recording is the conclusion of its survey.
CREATE TABLE findings (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    survey_id INTEGER NOT NULL REFERENCES surveys (id) ON DELETE CASCADE,
    recording_id INTEGER REFERENCES recordings (id) ON DELETE CASCADE,
    kind TEXT NOT NULL,
    body TEXT NOT NULL,
    cloud BLOB
);
CREATE INDEX findings_by_survey ON findings (survey_id);

CREATE TABLE prompts (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    survey_id INTEGER NOT NULL REFERENCES surveys (id) ON DELETE CASCADE,
    code TEXT NOT NULL,
    reason TEXT NOT NULL,
    remedy TEXT NOT NULL
);
CREATE INDEX prompts_by_survey ON prompts (survey_id);

-- Who said what, never overwritten: of the rows given after the newest recording, the last one on a question counts.
CREATE TABLE answers (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    survey_id INTEGER NOT NULL REFERENCES surveys (id) ON DELETE CASCADE,
    last_recording INTEGER,
    said TEXT NOT NULL,
    by_whom TEXT NOT NULL,
    note TEXT NOT NULL,
    created_ms INTEGER,
    clock_source TEXT NOT NULL
);
CREATE INDEX answers_by_survey ON answers (survey_id);
