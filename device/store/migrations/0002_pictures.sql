-- What the camera saw at the measurement, as JPEG; null where the camera had no such picture or the finding is older than this.
ALTER TABLE findings ADD COLUMN picture_color BLOB;
ALTER TABLE findings ADD COLUMN picture_depth BLOB;
