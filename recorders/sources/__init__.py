"""Sources of frames and detections: video, image folders, MOTChallenge text, CAVIAR XML."""
