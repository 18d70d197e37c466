"""What the box is plugged into: sensors and their virtual twins. Knows hardware and bytes, never a survey."""

import os

# cv2 reads it once, when it is first imported: without it a silent frame grabber holds its device for 10 s
os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")
