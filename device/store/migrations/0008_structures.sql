-- A structure survey maps a chamber: it hangs on a node, not on a pipe. The map is written with each scan, so that a power cut
-- loses the last scan and no more; it is compressed JSON.
CREATE TABLE structures (
    survey_id INTEGER PRIMARY KEY REFERENCES surveys (id) ON DELETE CASCADE,
    node_id INTEGER REFERENCES nodes (id),
    settings TEXT NOT NULL,
    summary TEXT NOT NULL DEFAULT '{}',
    map BLOB
);
CREATE INDEX structures_by_node ON structures (node_id);
