-- An inspection joins what the surveys of one pipe found into what the utility takes home. Coordinates are in the site's reference
-- system (crs, an EPSG number); a pipe's start_node is the upstream one.
ALTER TABLE sites ADD COLUMN crs INTEGER;
ALTER TABLE nodes ADD COLUMN easting REAL;
ALTER TABLE nodes ADD COLUMN northing REAL;
ALTER TABLE nodes ADD COLUMN level REAL;
ALTER TABLE pipes ADD COLUMN length_m REAL;

-- date is what the operator entered (ISO 8601), null where the clock's own counts.
CREATE TABLE inspections (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    pipe_id INTEGER NOT NULL REFERENCES pipes (id),
    operator TEXT NOT NULL DEFAULT '',
    date TEXT,
    direction TEXT NOT NULL,
    method TEXT NOT NULL,
    length_m REAL,
    note TEXT NOT NULL DEFAULT '',
    created_ms INTEGER,
    clock_source TEXT NOT NULL,
    boot_id TEXT NOT NULL,
    monotonic_ns INTEGER NOT NULL,
    deleted INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX inspections_by_pipe ON inspections (pipe_id, id);

-- station_m: where in the pipe a survey of one place looked, null for one that drove along.
CREATE TABLE inspection_surveys (
    inspection_id INTEGER NOT NULL REFERENCES inspections (id) ON DELETE CASCADE,
    survey_id INTEGER NOT NULL REFERENCES surveys (id) ON DELETE CASCADE,
    station_m REAL,
    PRIMARY KEY (inspection_id, survey_id)
);

-- Observations follow from the findings until somebody edits them; from then on the newest list counts, and taking it back is undo.
CREATE TABLE observation_lists (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    inspection_id INTEGER NOT NULL REFERENCES inspections (id) ON DELETE CASCADE,
    body TEXT NOT NULL,
    by_whom TEXT NOT NULL,
    created_ms INTEGER,
    clock_source TEXT NOT NULL
);
CREATE INDEX observation_lists_by_inspection ON observation_lists (inspection_id);

CREATE TABLE inspection_photos (
    inspection_id INTEGER NOT NULL REFERENCES inspections (id) ON DELETE CASCADE,
    name TEXT NOT NULL,
    jpeg BLOB NOT NULL,
    PRIMARY KEY (inspection_id, name)
);
