"""Frame to foreground mask to blobs to detections."""
