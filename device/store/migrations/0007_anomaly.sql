-- Of an anomaly survey: the reference picture with the deviations on it (JPEG), and the deviations of the unrolled wall.
ALTER TABLE findings ADD COLUMN overlay BLOB;
ALTER TABLE findings ADD COLUMN map BLOB;
