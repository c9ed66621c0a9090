"""Changes of the whole picture: light, infrared, a camera that shakes, is moved or turned, a lost
signal. They are measured, told, and compensated for.
"""
